"""Instructions to single servos on a bus that carries a robot: handshake, settings, homing, diagnosis."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Final, NamedTuple

from contid.errors import DeviceError
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.packets import (
    ALERT,
    BROADCAST,
    STATUS_ERROR_TEXT,
    Instruction,
    Packet,
    StatusError,
    build,
    read_parameters,
    sync_read,
)
from contid_drivers.dynamixel.port import ServoPort
from contid_drivers.dynamixel.registers import Register

#: Attempts of one read or write before the servo counts as silent.
TRIES: Final = 3
#: Latency allowance outside the tick.
ACYCLIC_LATENCY_S: Final = 0.03
#: Bytes of model number and firmware in the answer to a ping.
PING_SIZE: Final = 3
#: Answers to a broadcast ping take up to this time per id besides their bytes (as in the SDK).
PING_SLOT_S: Final = 3e-3
#: Lengths of the reads that separate requests; no register and no block is that long.
BARRIER_SIZES: Final = (5, 6, 7, 9, 10, 11)
#: The instruction arrived damaged, and the servo did nothing: it is repeated like one without an answer.
#: Every servo has the instructions of `ServoClient`, so another one was read. With an intact CRC the other
#: errors are true refusals (e-manual, Protocol 2.0, Status Packet).
_MISREAD: Final = (StatusError.INSTRUCTION, StatusError.CRC)
_NEED_ORDER: Final = (Instruction.READ, Instruction.WRITE)
#: A servo answers again within this time after a reboot.
REBOOT_S: Final = 2.0
#: Pause between pings to it.
REBOOT_PAUSE_S: Final = 0.01
#: Requests to one servo feed no other: after this time the others are read.
FEED_S: Final = 0.02
FEED_SIZE: Final = 3


class ServoError(DeviceError):
    """One servo did not do what it was asked; the port is not lost (`contid.errors.DeviceLostError`)."""


class NoAnswerError(ServoError):
    """A servo did not answer, or only damaged packets arrived, here or there."""


class ServoRefusedError(ServoError):
    """A servo understood an instruction and answered with an error."""


class Identity(NamedTuple):
    """What a servo answers to a ping: its model number, and the version of its firmware."""

    model: int
    firmware: int


class ServoClient:
    """Reads and writes registers of single servos."""

    def __init__(self, bus: str, port: ServoPort, names: Mapping[int, str] | None = None) -> None:
        self.bus = bus
        self.port = port
        self._names = names or {}
        #: Servos with a request whose answer has not come and may come late.
        self._unanswered: set[int] = set()
        self._barriers = 0
        #: Servos whose Bus Watchdog is on, and when something last addressed all of them [monotonic s].
        self.watched: Callable[[], Iterable[int]] = tuple
        self.fed_s = 0.0

    def expect_late(self, devices: Iterable[int]) -> None:
        """Answers of these servos to other requests may still arrive."""
        self._unanswered.update(devices)

    def name(self, device: int) -> str:
        """Name of a servo in messages."""
        axis = f" ({self._names[device]})" if device in self._names else ""
        return f"{self.bus}, servo {device}{axis}"

    def ping(self, device: int, tries: int = TRIES) -> int | None:
        """Model number of a servo, None when it is silent."""
        answer = self._ask(device, Instruction.PING, b"", PING_SIZE, tries)
        if answer is None or not answer.parameters:
            return None
        return int.from_bytes(answer.parameters[:2], "little")

    def broadcast_ping(self) -> dict[int, Identity]:
        """Every servo on the bus, by id."""
        self.port.flush()
        sent = self.port.send(build(BROADCAST, Instruction.PING))
        slot_s = PING_SLOT_S + self.port.status_s(PING_SIZE)
        return {
            answer.device: Identity(int.from_bytes(answer.parameters[:2], "little"), answer.parameters[2])
            for answer in self.port.packets(sent + BROADCAST * slot_s + self.port.latency_s)
            if answer.instruction == Instruction.STATUS and len(answer.parameters) == PING_SIZE
        }

    def read_block(self, device: int, address: int, size: int, tries: int = TRIES) -> bytes:
        """Bytes of the control table.

        Raises:
            NoAnswerError: the servo is silent, or only damaged packets arrive.
            ServoRefusedError: it answered with an error.
        """
        what = f"reading register {address}"
        return self._checked(device, what, Instruction.READ, read_parameters(address, size), size, tries)

    def look(self, device: int, address: int, size: int) -> bytes:
        """Bytes of the control table within a tick: one try, with the time-out of an exchange.

        Errors as `read_block`.
        """
        what, parameters = f"reading register {address}", read_parameters(address, size)
        return self._checked(
            device, what, Instruction.READ, parameters, size, 1, latency_s=self.port.latency_s
        )

    def read(self, device: int, register: Register) -> int:
        """Value of a register; errors as `read_block`."""
        return register.decode(self.read_block(device, register.address, register.size))

    def write(self, device: int, register: Register, value: int) -> None:
        """Set a register; errors as `read_block`."""
        parameters = register.address.to_bytes(2, "little") + register.encode(value)
        self._checked(device, f"writing {value} to {register.name}", Instruction.WRITE, parameters, 0, TRIES)

    def reboot(self, device: int) -> None:
        """Restart a servo and wait for its answer; its torque and turn count are lost.

        Raises:
            NoAnswerError: it does not answer again.
        """
        for _ in range(TRIES):
            answer = self._ask(device, Instruction.REBOOT, b"", 0, 1)
            if answer is not None and answer.error & ~ALERT not in _MISREAD:
                break
        until = time.monotonic() + REBOOT_S
        while time.monotonic() < until:
            # The answer to the reboot may arrive before the servo goes down.
            time.sleep(REBOOT_PAUSE_S)
            if self.ping(device, 1) is not None:
                return
        raise NoAnswerError(self.name(device), f"no answer within {REBOOT_S:g} s after a reboot")

    def _checked(
        self,
        device: int,
        what: str,
        instruction: Instruction,
        parameters: bytes,
        size: int,
        tries: int,
        *,
        latency_s: float = ACYCLIC_LATENCY_S,
    ) -> bytes:
        answer = self._ask(device, instruction, parameters, size, tries, latency_s)
        if answer is None:
            raise NoAnswerError(self.name(device), f"no answer ({what})", "check its power")
        if number := answer.error & ~ALERT:
            message = STATUS_ERROR_TEXT.get(number, f"error {number}")
            if number in _MISREAD:
                message = f"its instructions arrive damaged ({what}: {message})"
                raise NoAnswerError(self.name(device), message, "check its cable and supply")
            raise ServoRefusedError(self.name(device), f"{what} was refused: {message}")
        return answer.parameters

    def _ask(
        self,
        device: int,
        instruction: Instruction,
        parameters: bytes,
        size: int,
        tries: int,
        latency_s: float = ACYCLIC_LATENCY_S,
    ) -> Packet | None:
        """The servo's answer with ``size`` bytes or an error; skips others (echoed, of other servos).

        An answer names neither its instruction nor its register. After a time-out it may still come and would
        pass for the next one: `_barrier` first. An instruction that arrived damaged is repeated; when all
        did, the last answer is returned (`_MISREAD`).
        """
        answer = None
        for _ in range(tries):
            order = instruction in _NEED_ORDER and device in self._unanswered
            if order and not self._barrier(device, latency_s):
                continue
            answer = self._once(device, instruction, parameters, size, latency_s)
            if answer is None:
                self._unanswered.add(device)
            elif answer.error & ~ALERT not in _MISREAD:
                return answer
        return answer

    def _barrier(self, device: int, latency_s: float) -> bool:
        """Wait for the answer to a read of a length of its own; what came before it is dropped.

        The lengths differ from those of the registers and from barrier to barrier.
        """
        self._barriers += 1
        size = BARRIER_SIZES[self._barriers % len(BARRIER_SIZES)]
        if self._once(device, Instruction.READ, read_parameters(0, size), size, latency_s) is None:
            return False
        self._unanswered.discard(device)
        return True

    def _once(
        self, device: int, instruction: Instruction, parameters: bytes, size: int, latency_s: float
    ) -> Packet | None:
        port = self.port
        if time.monotonic() - self.fed_s > FEED_S:
            self._feed(device)
        allowance_s = port.return_delay_s + max(port.latency_s, latency_s)
        port.flush()
        sent = port.send(build(device, instruction, parameters))
        for answer in port.packets(sent + port.status_s(size) + allowance_s):
            if answer.instruction != Instruction.STATUS or answer.device != device:
                continue
            if len(answer.parameters) == size or (answer.error & ~ALERT and not answer.parameters):
                return answer
        return None

    def _feed(self, device: int) -> None:
        """Read the other servos whose watchdog is on; ``device`` is addressed next."""
        self.fed_s = time.monotonic()
        others = [each for each in self.watched() if each != device]
        if not others:
            return
        port = self.port
        port.flush()
        sent = port.send(sync_read(reg.BUS_WATCHDOG.address, FEED_SIZE, others))
        answer_s = port.status_s(FEED_SIZE) + port.return_delay_s
        missing = set(others)
        for answer in port.packets(sent + len(others) * answer_s + port.latency_s):
            missing.discard(answer.device)
            if not missing:
                break
        self._unanswered.update(missing)
