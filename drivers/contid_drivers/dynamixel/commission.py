"""Finding servos and giving them ids and baud rates: ``contid scan`` and ``contid servo``."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from serial.tools import list_ports

from contid.errors import DeviceError
from contid.hal import FoundDevice, Report
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.port import BlockingPort
from contid_drivers.dynamixel.protocol import ServoClient
from contid_drivers.serial_ports import find_port

#: Rates in the order of likelihood.
SCAN_BAUDS: Final = (1000000, 57600, 2000000, 4000000, 3000000, 115200, 9600)
LATENCY_S: Final = 0.02


def likely_ports() -> list[str]:
    """Serial ports of this machine, by-id names first."""
    stable = {str(path.resolve()): str(path) for path in sorted(Path("/dev/serial/by-id").glob("*"))}
    return [stable.get(port.device, port.device) for port in list_ports.comports() if port.vid is not None]


@contextmanager
def client_on(path: str, baud: int) -> Iterator[ServoClient]:
    """A client on a port, closed at the end."""
    port = BlockingPort(path, find_port(path, path), baud, LATENCY_S)
    port.open()
    try:
        yield ServoClient(path, port)
    finally:
        port.close()


def scan(ports: Sequence[str], bauds: Sequence[int], report: Report) -> list[FoundDevice]:
    """Ask everybody at every rate; a port that does not open is reported and passed over."""
    found: list[FoundDevice] = []
    for path in ports or likely_ports():
        for baud in bauds or SCAN_BAUDS:
            report(f"{path} at {baud} baud")
            try:
                with client_on(path, baud) as client:
                    here = client.broadcast_ping()
            except DeviceError as error:
                report(str(error))
                break
            for device, (model, firmware) in sorted(here.items()):
                name = reg.MODELS.get(model, f"model {model}")
                found.append(FoundDevice(path, baud, device, name, firmware))
    return found


def _only(client: ServoClient, device: int) -> None:
    if client.ping(device) is None:
        raise DeviceError(
            client.name(device), f"no answer at {client.port.baudrate} baud", "run `contid scan`"
        )
    if client.read(device, reg.TORQUE_ENABLE):
        raise DeviceError(client.name(device), "torque is on, its settings are locked", "relax it first")


def set_id(path: str, baud: int, device: int, new: int) -> None:
    """Give a servo another id.

    Raises:
        DeviceError: it is silent or under torque, or the new id is taken or is none.
    """
    if not reg.ID.low <= new <= reg.ID.high:
        raise DeviceError(path, f"{new} is no id; {reg.ID.low} to {reg.ID.high} are")
    with client_on(path, baud) as client:
        if client.ping(new) is not None:
            raise DeviceError(client.name(new), f"id {new} is taken", "connect one servo at a time")
        _only(client, device)
        client.write(device, reg.ID, new)
        if client.ping(new) is None:
            raise DeviceError(client.name(new), "does not answer to its new id", "run `contid scan`")


def set_baud(path: str, baud: int, device: int, new: int) -> None:
    """Give a servo another baud rate.

    Raises:
        DeviceError: it is silent or under torque, or it has no such rate.
    """
    code = next((code for code, rate in reg.BAUD_CODES.items() if rate == new), None)
    if code is None:
        raise DeviceError(
            path, f"no baud rate {new}; there are {', '.join(map(str, reg.BAUD_CODES.values()))}"
        )
    with client_on(path, baud) as client:
        _only(client, device)
        client.write(device, reg.BAUD, code)
    time.sleep(0.05)
    with client_on(path, new) as client:
        if client.ping(device) is None:
            raise DeviceError(client.name(device), f"does not answer at {new} baud", "run `contid scan`")


def reboot(path: str, baud: int, device: int) -> None:
    """Restart a servo: torque off, turn count gone, errors cleared.

    Raises:
        DeviceError: it is silent or does not come back.
    """
    with client_on(path, baud) as client:
        if client.ping(device) is None:
            raise DeviceError(client.name(device), f"no answer at {baud} baud", "run `contid scan`")
        client.reboot(device)
