"""``contid servo``: ids, baud rates and restarts of single servos, through the stock SDK.

It is sound here, because no robot moves and each request stands alone: docs/decisions/0004.
"""

from __future__ import annotations

import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from dynamixel_sdk import COMM_RX_CORRUPT, COMM_RX_TIMEOUT, COMM_SUCCESS, PacketHandler, PortHandler

from contid.errors import DeviceError
from contid.kit.serial_ports import find_port
from contid_drivers.dynamixel import duplicates
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.client import REBOOT_S, TRIES, Identity
from contid_drivers.dynamixel.packets import ALERT
from contid_drivers.dynamixel.port import ServoPort
from contid_drivers.dynamixel.registers import Register

#: Option of FACTORY RESET.
KEEP_ID_AND_BAUD: Final = 2
#: Allowance for the delay of the adapter, as `ServoPort` has it.
LATENCY_S: Final = 0.02
#: Longest wait of one read of the port by the SDK, which reads again until its own time-out.
READ_WAIT_S: Final = 0.005
#: Pause before each ping of a servo that restarts.
RESTART_PAUSE_S: Final = 0.05
#: Pause between the order to change its baud rate and the first request at the new one.
NEW_BAUD_S: Final = 0.05
#: Remedy where answers to reads and writes are switched off; "it" is the Status Return Level.
RESTORE_LEVEL: Final = "`contid servo reboot` sets it to 2, as does `contid run`"


class SdkBus:
    """Servos at one baud rate of a locked port, through the SDK's packet handler."""

    def __init__(self, path: str, handler: PortHandler, port: ServoPort) -> None:
        self.path = path
        self.port = port
        self._port = handler
        self._sdk = PacketHandler(2.0)

    def name(self, device: int) -> str:
        """Name of a servo in messages."""
        return f"{self.path}, servo {device}"

    def answers(self, device: int) -> bool:
        """Whether a servo answers a ping."""
        return any(self._sdk.ping(self._port, device)[1] == COMM_SUCCESS for _ in range(TRIES))

    def broadcast_ping(self) -> dict[int, Identity]:
        """Every servo on the bus, by id."""
        found, _ = self._sdk.broadcastPing(self._port)
        return {device: Identity(*answer) for device, answer in sorted(found.items())}

    def read(self, device: int, register: Register) -> int:
        """Value of a register.

        Raises:
            DeviceError: no answer, or an error of the servo.
        """
        at, size = register.address, register.size
        data = self._checked(device, lambda: self._sdk.readTxRx(self._port, device, at, size))
        return register.decode(bytes(data[0]))

    def write(self, device: int, register: Register, value: int) -> None:
        """Set a register; errors as `read`."""
        at, data = register.address, list(register.encode(value))
        self._checked(device, lambda: self._sdk.writeTxRx(self._port, device, at, len(data), data))

    def reboot(self, device: int) -> None:
        """Restart a servo and wait for its answer.

        Raises:
            DeviceError: it does not restart, or does not answer again.
        """
        for _ in range(TRIES):
            ordered_s = time.monotonic()
            # A servo that answers pings only, which a reboot cures, does not answer this one.
            self._sdk.reboot(self._port, device)
            self._await(device, "a reboot")
            if self._began_since(device, ordered_s):
                return
        raise DeviceError(
            self.name(device), "it does not restart", "check its cable, or switch its power off and on"
        )

    def _began_since(self, device: int, host_s: float) -> bool:
        """Whether a servo started after a time of the host: its Realtime Tick counts from its start."""
        try:
            tick_ms = self.read(device, reg.REALTIME_TICK)
        except DeviceError:
            return False
        return tick_ms < 1e3 * (time.monotonic() - host_s)

    def _await(self, device: int, what: str) -> None:
        """Wait for the answer of a servo that restarts."""
        until = time.monotonic() + REBOOT_S
        while time.monotonic() < until:
            # The answer to the reboot may arrive before the servo goes down.
            time.sleep(RESTART_PAUSE_S)
            if self.answers(device):
                return
        raise DeviceError(self.name(device), f"no answer within {REBOOT_S:g} s after {what}")

    def factory_reset(self, device: int) -> None:
        """Factory values of every setting but id and baud rate; waits for the restart.

        Raises:
            DeviceError: no answer, or an error of the servo.
        """
        self._checked(device, lambda: self._sdk.factoryReset(self._port, device, KEEP_ID_AND_BAUD))
        self._await(device, "a factory reset")

    def _checked(self, device: int, request: Callable[[], tuple[Any, ...]]) -> tuple[Any, ...]:
        for _ in range(TRIES):
            *data, result, error = request()
            if result == COMM_SUCCESS:
                # The alert bit reports a hardware error; the request was carried out all the same.
                refusal = error & ~ALERT
                if refusal:
                    raise DeviceError(self.name(device), self._sdk.getRxPacketError(refusal))
                return tuple(data)
        raise DeviceError(self.name(device), *self._why(device, result))

    def _why(self, device: int, result: int) -> tuple[str, str]:
        """Cause and remedy of a request without a proper answer."""
        if result == COMM_RX_CORRUPT:
            return f"broken answers: {duplicates.CAUSE}", duplicates.REMEDY
        if result != COMM_RX_TIMEOUT:
            return self._sdk.getTxRxResult(result), "check power and cable"
        if self.answers(device):
            level = f"its Status Return Level ({reg.STATUS_RETURN_LEVEL.address}) is below 2"
            return f"answers a ping, but not this: {level}", RESTORE_LEVEL
        return f"no answer at {self._port.baudrate} baud", "check its id, power and cable: `contid scan`"


@contextmanager
def sdk_bus(path: str, baud: int) -> Iterator[SdkBus]:
    """The stock SDK on a port that contid opened and locked; closed at the end."""
    port = ServoPort(path, find_port(path, path), baud, LATENCY_S)
    # The SDK polls; with a timeout its reads block instead of spinning.
    port.serial.timeout = READ_WAIT_S
    handler = PortHandler(port.path)
    handler.ser, handler.is_open, handler.baudrate = port.serial, True, baud
    handler.tx_time_per_byte = 1e3 * port.byte_s
    try:
        yield SdkBus(path, handler, port)
    except (OSError, termios.error) as error:
        raise port.lost(error) from error
    finally:
        port.close()


def check_free(bus: SdkBus, device: int, baud: int) -> None:
    """Require exactly one servo of an id, without torque.

    Raises:
        DeviceError: no servo can have the id, none answers, two do, or its torque is on.
    """
    if not reg.ID.low <= device <= reg.ID.high:
        raise DeviceError(bus.path, f"no servo has id {device}; allowed {reg.ID.low} to {reg.ID.high}")
    answers = duplicates.count_answers(bus.port, device)
    if answers.duplicated:
        message = f"its settings stay, because {duplicates.CAUSE}; both would change"
        raise DeviceError(bus.name(device), message, "connect one servo at a time")
    if not answers.single and not bus.answers(device):
        raise DeviceError(bus.name(device), f"no answer at {baud} baud", "run `contid scan`")
    if bus.read(device, reg.TORQUE_ENABLE):
        raise DeviceError(bus.name(device), "torque is on, its settings are locked", "relax it first")


def set_id(path: str, baud: int, device: int, new: int) -> None:
    """Give a servo another id.

    Raises:
        DeviceError: it is silent or under torque, or the new id is invalid or taken.
    """
    if not reg.ID.low <= new <= reg.ID.high:
        raise DeviceError(path, f"invalid id {new}; allowed {reg.ID.low} to {reg.ID.high}")
    with sdk_bus(path, baud) as bus:
        if bus.answers(new):
            raise DeviceError(bus.name(new), f"id {new} is taken", "connect one servo at a time")
        check_free(bus, device, baud)
        bus.write(device, reg.ID, new)
        if not bus.answers(new):
            raise DeviceError(bus.name(new), "does not answer to its new id", "run `contid scan`")


def set_baud(path: str, baud: int, device: int, new: int) -> None:
    """Give a servo another baud rate.

    Raises:
        DeviceError: it is silent or under torque, or it has no such rate.
    """
    code = next((code for code, rate in reg.BAUD_CODES.items() if rate == new), None)
    if code is None:
        rates = ", ".join(map(str, reg.BAUD_CODES.values()))
        raise DeviceError(path, f"invalid baud rate {new}; allowed {rates}")
    with sdk_bus(path, baud) as bus:
        check_free(bus, device, baud)
        bus.write(device, reg.BAUD, code)
    time.sleep(NEW_BAUD_S)
    with sdk_bus(path, new) as bus:
        if not bus.answers(device):
            raise DeviceError(bus.name(device), f"does not answer at {new} baud", "run `contid scan`")


def reboot(path: str, baud: int, device: int) -> None:
    """Restart a servo: torque off, turn count lost, errors cleared.

    Raises:
        DeviceError: it is silent or does not answer again.
    """
    with sdk_bus(path, baud) as bus:
        if not bus.answers(device):
            raise DeviceError(bus.name(device), f"no answer at {baud} baud", "run `contid scan`")
        bus.reboot(device)
