"""``contid scan``: servos on serial ports, at every rate; servos of Protocol 1.0 are named as unsupported.

The rates of new servos (57600) and of contid (1000000) are asked first, all ports at once; they take 2.3 s.
The other rates follow on ports where nothing answered. A broadcast ping lasts as long as 253 servos would
answer, because each waits for the turn of its id.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

from contid.errors import DeviceError
from contid.hal import FoundDevice, Report
from contid.kit.serial_ports import usb_ports
from contid_devices.dynamixel.commission import sdk_bus
from contid_drivers.dynamixel.models import PROTOCOL_1_NUMBERS, model_name
from contid_drivers.dynamixel.port import ServoPort

USUAL_BAUDS: Final = (1000000, 57600)
OTHER_BAUDS: Final = (2000000, 4000000, 3000000, 115200, 9600)
#: Answers of Protocol 1.0 to a broadcast ping begin within this time.
PROTOCOL_1_S: Final = 0.05
#: Protocol 1.0: id of a broadcast and greatest id of one servo; instructions; registers of the model number.
_BROADCAST_1: Final = 0xFE
_GREATEST_ID_1: Final = 0xFD
_PING_1: Final = 0x01
_READ_1: Final = 0x02
_MODEL_ADDRESS_1, _MODEL_BYTES_1 = 0, 2
#: Bytes of the shortest status of Protocol 1.0: two of the header, id, length, error and checksum.
_STATUS_BYTES_1: Final = 6


def scan(ports: Sequence[str], bauds: Sequence[int], report: Report) -> list[FoundDevice]:
    """Search ports; one that does not open is reported and skipped.

    Without named ports no Arduino board's port is opened, because that resets most boards. Of the named ports
    only those of a Due are left out; a named port of another Arduino board is opened.

    Args:
        ports: empty for every USB serial port that is no Arduino or Teensy board's.
        bauds: empty for the usual rates, and where nothing answers the others.
        report: takes lines about the progress.
    """
    paths = [path for path in ports if not _is_due(path, report)] if ports else likely_ports(report)
    if not paths:
        return []

    def search(path: str) -> list[FoundDevice]:
        found = list(_at(path, bauds or USUAL_BAUDS, report))
        return found if found or bauds else list(_at(path, OTHER_BAUDS, report))

    with ThreadPoolExecutor(len(paths)) as pool:
        return [device for found in pool.map(search, paths) for device in found]


def likely_ports(report: Report) -> list[str]:
    """USB serial ports that a servo adapter may have. Opening an Arduino's port resets its board."""
    ports = usb_ports()
    for port in ports:
        if port.arduino:
            report(f"{port.path}: an Arduino or Teensy board; not opened at servo rates")
    return [port.path for port in ports if not port.arduino]


def _is_due(path: str, report: Report) -> bool:
    due = any(port.due and Path(port.path).resolve() == Path(path).resolve() for port in usb_ports())
    if due:
        report(f"{path}: an Arduino Due; not opened at servo rates")
    return due


def _at(path: str, bauds: Sequence[int], report: Report) -> Iterator[FoundDevice]:
    """Devices of one port at some rates."""
    for baud in bauds:
        report(f"{path} at {baud} baud")
        try:
            with sdk_bus(path, baud) as bus:
                present = bus.broadcast_ping()
                old = protocol_1(bus.port)
        except DeviceError as error:
            report(str(error))
            return
        for device, servo in present.items():
            yield FoundDevice(path, baud, device, model_name(servo.model), servo.firmware)
        for device, number in old.items():
            name = PROTOCOL_1_NUMBERS.get(number, f"model {number}")
            yield FoundDevice(path, baud, device, f"{name} (Protocol 1.0, not supported)", 0)


def protocol_1(port: ServoPort) -> dict[int, int]:
    """Model number by id of the servos that answer to Protocol 1.0; 0 when it is not answered.

    A packet is ``FF FF ID LEN INST PARAM.. CHECK``. LEN counts the bytes behind it; CHECK is the inverted sum
    of the bytes from ID on, so that the sum with CHECK is FF. A status has its error in place of INST.
    Source: e-manual, Protocol 1.0.
    """
    answered = _ask_1(port, _BROADCAST_1, bytes((_PING_1,)))
    found = {}
    for device in answered:
        request = bytes((_READ_1, _MODEL_ADDRESS_1, _MODEL_BYTES_1))
        number = _ask_1(port, device, request).get(device, b"")
        found[device] = int.from_bytes(number[:_MODEL_BYTES_1], "little")
    return found


def _ask_1(port: ServoPort, device: int, body: bytes) -> dict[int, bytes]:
    """Parameters of the intact answers to an instruction of Protocol 1.0, by id.

    ``body`` is the instruction and its parameters. Packets are compared from ID on. What equals the packet
    that was sent is its echo, which some adapters return, and no answer.
    """
    sent = bytes((device, len(body) + 1)) + body
    sent += bytes((~sum(sent) & 0xFF,))
    port.flush()
    deadline = port.send(b"\xff\xff" + sent) + PROTOCOL_1_S
    stream = b""
    while time.monotonic() < deadline and (data := port.receive(deadline)):
        stream += data
    answers = {}
    for at in range(len(stream) - _STATUS_BYTES_1 + 1):
        if stream[at : at + 2] != b"\xff\xff" or stream[at + 2] > _GREATEST_ID_1:
            continue
        answering, length = stream[at + 2], stream[at + 3]
        status = stream[at + 2 : at + 4 + length]
        whole = len(status) == 2 + length and length >= 2
        if whole and sum(status) & 0xFF == 0xFF and status != sent:
            answers[answering] = status[3:-1]
    return answers
