"""Feetech servos in software, on a pseudo terminal: for use without hardware and for the tests."""

from __future__ import annotations

import select
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, Literal

from contid.errors import ContidError
from contid.hal import AxisOnBus
from contid_driverkit import ControlFile, PseudoPort
from contid_feetech import FeetechAxisOptions, FeetechOptions
from contid_feetech.bus import CURRENT_A, GOAL, STEPS_PER_RAD, TORQUE
from contid_feetech.wire import BROADCAST, READ, SYNC_READ, SYNC_WRITE, WRITE, packet, signed, take

PING, SPEED, PRESENT = 0x01, 46, 56
#: Of an STS3215 at 7.4 V [steps/s]; an SCS servo has a quarter of the steps.
NO_LOAD: Final = 3400.0
OVERLOAD: Final = 1 << 5


class Servo:
    """One servo: its registers, and a shaft that goes to its goal at one speed while it has torque.

    Attributes:
        position: of the shaft [steps].
        error: error byte of its answers; while it is not 0 there is no torque.
        silent: it neither receives nor answers.
        stops: end stops of the shaft [steps]; ``jammed``: it does not turn.
    """

    def __init__(self, device: int, series: str, position: float) -> None:
        self.memory = bytearray(96)
        self.order: Literal["little", "big"] = "little" if series == "sts" else "big"
        self.sts, self.position, self.error, self.silent = series == "sts", position, 0, False
        self.stops, self.jammed = (-1e9, 1e9), False
        self.memory[3], self.memory[4], self.memory[5] = (9, 3, device) if self.sts else (5, 4, device)
        self.put(11, 4095 if self.sts else 1023)
        self.memory[62], self.memory[63] = 74, 30

    def put(self, at: int, number: int) -> None:
        """Set a word of the registers."""
        word = number if number >= 0 else 0x8000 - number
        self.memory[at : at + 2] = word.to_bytes(2, self.order)

    def get(self, at: int) -> int:
        """A word of the registers."""
        return signed(int.from_bytes(self.memory[at : at + 2], self.order))

    def advance(self, seconds: float) -> None:
        """Move for a time [s], and renew what the servo measures."""
        if self.error:
            self.memory[TORQUE] = 0
        way, top = 0.0, NO_LOAD if self.sts else NO_LOAD / 4
        if self.memory[TORQUE]:
            low, high = self.get(9), self.get(11)
            goal = self.get(GOAL) if low == high == 0 else min(max(self.get(GOAL), low), high)
            reach = (min(self.get(SPEED), top) or top) * seconds
            way = max(-reach, min(reach, goal - self.position))
            free = min(max(self.position + way, self.stops[0]), self.stops[1]) - self.position
            # A blocked motor draws current by its error, a free one little.
            amps = 0.05 if free == way else min(2.0, 0.01 * abs(goal - self.position))
            self.put(69, round(amps / CURRENT_A))
            way = 0.0 if self.jammed else free
        self.position += way
        self.put(PRESENT, round(self.position))
        self.put(58, round(way / seconds) if seconds > 0 else 0)
        self.memory[65], self.memory[66] = self.error, way != 0.0

    def answer(self, data: bytes = b"") -> bytes:
        """The packet of an answer."""
        return packet(self.memory[5], self.error, data)


class FeetechEmulator:
    """The servos of a bus behind one adapter, from entering to leaving the context."""

    def __init__(self, port: str, servos: Sequence[Servo], *, echo: bool = False) -> None:
        self.servos = {servo.memory[5]: servo for servo in servos}
        self.echo, self.port = echo, port
        self.lock = threading.Lock()
        self._port = PseudoPort(port)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="feetech emulator")
        self._now = time.monotonic()
        self._control: ControlFile | None = None

    def __enter__(self) -> FeetechEmulator:
        self._port.plug()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._port.unplug()

    def follow(self, control: Path) -> None:
        """Obey the lines of a file: ``{"fault": "silent", "id": 2, "on": true}``."""
        self._control = ControlFile(control, self.switch)

    def switch(self, given: Any) -> None:
        """One switch: ``silent`` or ``overload`` of an id, ``echo``, or ``unplug`` of the adapter."""
        name, on = given["fault"], given.get("on", True)
        with self.lock:
            if name in ("silent", "overload"):
                if given.get("id") not in self.servos:
                    raise ContidError(f"no servo with id {given.get('id')}")
                servo = self.servos[given["id"]]
                if name == "silent":
                    servo.silent = on
                else:
                    servo.error = OVERLOAD if on else 0
            elif name == "echo":
                self.echo = on
            elif name == "unplug":
                self._port.unplug() if on else self._port.plug()
            else:
                raise ContidError(f"unknown fault {name!r}; known: silent, overload, echo, unplug")
            self.advance()

    def advance(self) -> None:
        """Move every shaft to the present; the lock must be held."""
        now = time.monotonic()
        for servo in self.servos.values():
            servo.advance(now - self._now)
        self._now = now

    def _serve(self) -> None:
        stream = bytearray()
        while not self._ended.is_set():
            if self._control is not None:
                self._control.poll()
            with self.lock:
                watched = [self._port.descriptor] if self._port.plugged else []
            select.select(watched, [], [], 0.005)
            with self.lock:
                if not self._port.plugged:
                    stream.clear()
                    continue
                received = self._port.read()
                if received and self.echo:
                    self._port.write(received)
                stream += received
                for device, code, data in take(stream):
                    self.advance()
                    if answers := b"".join(self._answers(device, code, data)):
                        self._port.write(answers)

    def _answers(self, device: int, code: int, data: bytes) -> Iterator[bytes]:
        """Carry out an instruction; the answers, in the order of the request."""
        listening = {each: servo for each, servo in self.servos.items() if not servo.silent}
        if device == BROADCAST and code == SYNC_WRITE:
            for at in range(2, len(data), data[1] + 1):
                if data[at] in listening:
                    listening[data[at]].memory[data[0] : data[0] + data[1]] = data[at + 1 : at + 1 + data[1]]
        elif device == BROADCAST and code == SYNC_READ:
            for each in data[2:]:
                if each in listening and listening[each].sts:  # SCS servos have no such instruction
                    yield listening[each].answer(bytes(listening[each].memory[data[0] : data[0] + data[1]]))
        elif device in listening:
            servo = listening[device]
            if code == WRITE:
                servo.memory[data[0] : data[0] + len(data) - 1] = data[1:]
            if code in (PING, WRITE):
                yield servo.answer()
            elif code == READ:
                yield servo.answer(bytes(servo.memory[data[0] : data[0] + data[1]]))


@contextmanager
def emulated(
    options: FeetechOptions, axes: Sequence[AxisOnBus], control: Path | None = None
) -> Iterator[Sequence[str]]:
    """The servos of one bus at its port (`contid.hal.Emulates`); each begins in the middle of its travel."""
    servos = []
    for axis in axes:
        assert isinstance(axis.options, FeetechAxisOptions)
        low, high = axis.travel or (0.0, 0.0)
        middle = (low + high) / 2.0 * STEPS_PER_RAD[options.series]
        servos.append(Servo(axis.options.id, options.series, round(middle)))
    with FeetechEmulator(options.port, servos, echo=options.echo) as emulator:
        if control is not None:
            emulator.follow(control)
        yield [f"{options.port}: {options.series} servos {', '.join(map(str, emulator.servos))}"]
