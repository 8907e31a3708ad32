"""Regulators and their chambers, written apart from the firmware's plant, behind the interface of a bus.

A command is a voltage, the regulator's own loop fills its chamber through a valve of finite flow, air leaks
through an orifice, and the output of the regulator is a voltage again: faults are in the wires, in the
ranges of command and output, or in the chamber. Time is virtual.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from contid.hal import Rest, Sample

FULL_PA, FULL_V = 3e5, 10.0
STEP_S = 1e-3
ADC_STEPS = 4095


@dataclass
class Regulator:
    """One regulator of 0 to 3 bar for 0 to 10 V, at its chamber.

    Attributes:
        lag_s, flow_pa_s: of the pressure; ``leak`` [sqrt(Pa)/s] of an orifice.
        command_gain, output_gain: 0.5 or 2 where a range of 5 V stands for 10 V; 0 for an open wire.
        output_v: the output is at this voltage, whatever the pressure; None: it works.
        blocked: it fills, but does not exhaust.
    """

    lag_s: float = 0.15
    flow_pa_s: float = 4e5
    leak: float = 0.0
    command_gain: float = 1.0
    output_gain: float = 1.0
    output_v: float | None = None
    offset_v: float = 0.0
    blocked: bool = False
    pressure_pa: float = 0.0

    def step(self, command_v: float) -> None:
        target = command_v * self.command_gain / FULL_V * FULL_PA
        rate = max(-self.flow_pa_s, min(self.flow_pa_s, (target - self.pressure_pa) / self.lag_s))
        if self.blocked:
            rate = max(rate, 0.0)
        rate -= self.leak * math.sqrt(max(self.pressure_pa, 0.0))
        self.pressure_pa = max(self.pressure_pa + rate * STEP_S, 0.0)

    def volts(self) -> float:
        if self.output_v is not None:
            return self.output_v
        return self.pressure_pa / FULL_PA * FULL_V * self.output_gain + self.offset_v


@dataclass
class Chambers:
    """A bus of regulators and its clock; ``command_of`` and ``output_of`` are the wires by channel.

    Its board ramps a command by 2 bar/s, and shuts a channel off that reads less than half of it for 0.5 s.
    """

    regulators: Sequence[Regulator]
    command_of: Mapping[int, int] = field(default_factory=dict)
    output_of: Mapping[int, int] = field(default_factory=dict)
    name: str = "board"
    enabled: set[int] = field(default_factory=set)
    time_s: float = 0.0

    def __post_init__(self) -> None:
        self.axes = tuple(f"arm.p{i}" for i in range(len(self.regulators)))
        count = len(self.axes)
        self._goal, self._set, self._low_s, self._off = (
            [0.0] * count,
            [0.0] * count,
            [0.0] * count,
            [False] * count,
        )
        self.highest_pa = 0.0

    def now(self) -> float:
        return self.time_s

    def sleep(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self._step()

    def _step(self) -> None:
        self.time_s += STEP_S
        for i in range(len(self.axes)):
            goal = self._goal[i] if i in self.enabled and not self._off[i] else 0.0
            ramp = 2e5 * STEP_S
            self._set[i] += max(-ramp, min(ramp, goal - self._set[i]))
            regulator = self.regulators[self.command_of.get(i, i)]
            regulator.step(self._set[i] / FULL_PA * FULL_V)
            self.highest_pa = max(self.highest_pa, regulator.pressure_pa)
            low = goal > 0.0 and self._set[i] == goal and self._reading(i) < 0.5 * goal
            self._low_s[i] = self._low_s[i] + STEP_S if low else 0.0
            self._off[i] = self._off[i] or self._low_s[i] > 0.5

    def _reading(self, i: int) -> float:
        steps = round(self.regulators[self.output_of.get(i, i)].volts() / FULL_V * ADC_STEPS)
        return steps / ADC_STEPS * FULL_PA

    def open(self) -> None: ...

    def close(self) -> None: ...

    def enable(self, axes: Sequence[str]) -> None:
        self.enabled |= {self.axes.index(axis) for axis in axes}

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        assert rest is Rest.VENT
        self.enabled -= {self.axes.index(axis) for axis in axes}

    def clear_fault(self, axes: Sequence[str]) -> None:
        for axis in axes:
            self._off[self.axes.index(axis)] = False

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        for axis, value in commands.items():
            assert self.axes.index(axis) in self.enabled, "commanded without being enabled"
            self._goal[self.axes.index(axis)] = value
        self.sleep(2 * STEP_S)
        return {
            axis: Sample(self._reading(i), self.time_s, True, 0.0, fault="leak" if self._off[i] else "")
            for i, axis in enumerate(self.axes)
        }
