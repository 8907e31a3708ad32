"""A bus of Feetech servos: radians outside, steps inside."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Final, Literal

from contid.errors import DeviceError, DeviceNotFoundError
from contid.hal import AxisOnBus, Clock
from contid_driverkit import Reading, SerialBus
from contid_feetech import FeetechAxisOptions, FeetechOptions
from contid_feetech.wire import BROADCAST, ERRORS, READ, SYNC_READ, SYNC_WRITE, Answer, packet, signed, take

MODEL, MODE, TORQUE, GOAL = 3, 33, 40, 42
SETTINGS, STATE = (MODEL, 31), (TORQUE, 31)  # first register and size: at opening, in an exchange
#: Series by the major version of a servo (register 3): SCS0009 5, SM8512 8, STS3215 and STS3250 9.
SERIES: Final = {5: "scs", 8: "sts", 9: "sts"}
STEPS_PER_RAD: Final = {"sts": 4096 / math.tau, "scs": 1024 / math.radians(300)}
CURRENT_A: Final = 0.0065  # per unit of register 69


class FeetechBus(SerialBus):
    """See `contid_driverkit.SerialBus`."""

    def __init__(self, name: str, options: FeetechOptions, axes: Sequence[AxisOnBus], clock: Clock) -> None:
        line = options.model_dump(include={"port", "baud", "echo"})
        super().__init__(name, axes, clock, latency_s=options.latency_ms / 1e3, **line)
        self._series, self._given, self._sts = options.series, axes, options.series == "sts"
        self._of = {each.name: each.options for each in axes if isinstance(each.options, FeetechAxisOptions)}
        self._order: Literal["little", "big"] = "little" if self._sts else "big"
        self._scale = STEPS_PER_RAD[options.series]

    def check(self) -> None:
        found = self._ask(*SETTINGS) | self._ask(*SETTINGS) | self._ask(*SETTINGS)
        wrong = [why for axis in self._given if (why := self._objection(axis, found.get(axis.name)))]
        if wrong:
            remedy = "check power, ids and baud rate; registers are set by programs of Feetech"
            raise DeviceNotFoundError(self.name, "; ".join(wrong), remedy)

    def _objection(self, axis: AxisOnBus, answer: Answer | None) -> str:
        """Why the servo of an axis cannot be used, "" when it can."""
        who = f"{axis.name} (id {self._of[axis.name].id})"
        if answer is None:
            return f"no answer from {who}"
        if (series := SERIES.get(answer.data[0], self._series)) != self._series:
            return f"{who} is of series {series}, not {self._series}"
        low, high = (self._number(answer.data, at - MODEL) for at in (9, 11))
        unlimited = low == high == 0  # STS: seven turns; SCS: no control of the position
        if (self._sts and answer.data[MODE - MODEL]) or (unlimited and not self._sts):
            return f"{who} does not control its position (register 33 of STS, 9 to 12 of SCS)"
        low, high = (-30719, 30719) if unlimited else (low, high)
        steps = [limit * self._scale for limit in axis.travel or ()]
        if any(not low - 1 <= step <= high + 1 for step in steps):
            return f"{who} moves from step {low} to {high}, its axis {steps[0]:.0f} to {steps[1]:.0f}"
        return ""

    def read(self) -> Mapping[str, Reading]:
        return {axis: self._reading(answer) for axis, answer in self._ask(*STATE).items()}

    def _reading(self, answer: Answer) -> Reading:
        data, number = answer.data, self._number
        value, velocity = number(data, 16) / self._scale, number(data, 18) / self._scale
        effort = number(data, 29) * CURRENT_A if self._sts else None
        bits = [bit for bit in range(8) if answer.error >> bit & 1]
        fault = ", ".join(ERRORS.get(bit, f"error bit {bit}") for bit in bits)
        goal = number(data, GOAL - TORQUE) / self._scale
        return Reading(value, data[0] != 0, fault, goal, velocity, effort, float(data[23]), data[22] / 10)

    def send(self, goals: Mapping[str, float]) -> None:
        blocks = {}
        for axis, value in goals.items():
            options, goal = self._of[axis], round(value * self._scale)
            if not (-0x7FFF if self._sts else 0) <= goal <= 0x7FFF:
                raise DeviceError(axis, f"step {goal} is beyond what a servo can be sent")
            speed = round(math.radians(options.speed_deg_s) * self._scale)
            numbers = [goal if goal >= 0 else 0x8000 - goal, 0, speed]  # goal, time, speed
            acceleration = bytes([options.acceleration]) if self._sts else b""
            blocks[axis] = acceleration + b"".join(each.to_bytes(2, self._order) for each in numbers)
        self._write(GOAL - self._sts, blocks)

    def power(self, axes: Collection[str], on: bool) -> None:
        self._write(TORQUE, dict.fromkeys(axes, bytes([on])))

    def _number(self, data: bytes, at: int) -> int:
        return signed(int.from_bytes(data[at : at + 2], self._order))

    def _write(self, address: int, blocks: Mapping[str, bytes]) -> None:
        """Write registers of several servos by one packet, which none answers."""
        if blocks:
            data = b"".join(bytes([self._of[axis].id]) + block for axis, block in blocks.items())
            size = len(data) // len(blocks) - 1
            self.line.send(packet(BROADCAST, SYNC_WRITE, bytes([address, size]) + data))

    def _ask(self, address: int, size: int) -> dict[str, Answer]:
        """Registers of every servo that answers in time: STS by one request, SCS one after the other."""
        port, what = self.line, bytes([address, size])
        axis_of = {each.id: axis for axis, each in self._of.items()}
        requests = [(packet(BROADCAST, SYNC_READ, what + bytes(axis_of)), list(axis_of))]
        if not self._sts:
            requests = [(packet(each, READ, what), [each]) for each in axis_of]
        found: dict[str, Answer] = {}
        for request, ids in requests:
            stream, left = bytearray(), set(ids)
            port.flush()
            until = port.send(request) + len(ids) * (size + 6) * port.byte_s + port.latency_s
            while left and (data := port.receive(until)):
                stream += data
                for each in take(stream):
                    if each.device in left and len(each.data) == size:
                        left.discard(each.device)
                        found[axis_of[each.device]] = each
        return found
