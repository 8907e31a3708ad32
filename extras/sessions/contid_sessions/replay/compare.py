"""Comparison of a replayed tick with the recorded one, bit for bit or within a tolerance.

The order is that of cause and effect: target, solution, command, device, limits, then the state of the robot.
Values that only describe (iterations, residuals, timing) are not compared.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Final

from contid.control.engine.tick_layout import AXIS, ROBOT, SOURCE_TIME, TICK, RecordLayout
from contid.control.tick.faults import Fault
from contid.control.tick.supervisor import Mode
from contid.session.format.channels import SI
from contid.units import DEG
from contid_sessions.info import name_of

_PER_SI: Final = {"m": 1e3, "pa": 1e-5, "rad": 1.0 / DEG}
_UNITS: Final = {"_m": "m", "_n": "n"}


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first value that differs.

    Attributes:
        time_s: time of the tick since the start.
        source_s: time in the trajectory, NaN without one.
        axis: "" for a value of the whole robot.
        what: name of the value.
        unit: unit of both values.
        last_equal: values of the robot in the last tick that was equal.
    """

    tick: int
    time_s: float
    source_s: float
    robot: str
    axis: str
    what: str
    recorded: float
    replayed: float
    unit: str
    last_equal: Mapping[str, Any]

    @property
    def goes_on(self) -> bool:
        """What follows can still be compared: another number, not another state, fault or limit."""
        return bool(self.unit)

    @property
    def where(self) -> str:
        """``robot.axis``."""
        return f"{self.robot}.{self.axis}" if self.axis else self.robot


@dataclass(frozen=True, slots=True)
class _Value:
    """A value of a record that a replay compares."""

    slot: int
    robot: int
    axis: str
    what: str
    unit: str


class Comparison:
    """Compares ticks in their order.

    Attributes:
        largest: largest difference of a command so far [m or Pa].
        worst: where it is, None while every command is equal.
        different: ticks that differ by more than the tolerance.
    """

    def __init__(self, layout: RecordLayout, device_units: Mapping[str, str], tolerance: float) -> None:
        """Prepare; ``tolerance`` in mm or bar, 0 compares bit for bit."""
        self._layout = layout
        self._tolerance = tolerance
        self._values = list(_compared(layout, device_units, exact=tolerance == 0.0))
        slots = [value.slot for value in self._values]
        self._pick = itemgetter(*slots)
        self._pack = struct.Struct(f"{len(slots)}d").pack
        self._previous: Sequence[float] | None = None
        self.largest = 0.0
        self.worst: Divergence | None = None
        self.different = 0

    def check(self, recorded: Sequence[float], replayed: Sequence[float]) -> Divergence | None:
        """The first difference of a tick, None if it is equal."""
        then, now = self._pick(recorded), self._pick(replayed)
        first = None
        if self._pack(*then) != self._pack(*now):
            for value, old, new in zip(self._values, then, now, strict=True):
                if value.what == "command" and abs(old - new) > self.largest:
                    self.largest = abs(old - new)
                    self.worst = self._divergence(value, old, new, recorded)
                if first is None and not self._same(value, old, new):
                    first = self._divergence(value, old, new, recorded)
        if first is None:
            self._previous = recorded
        else:
            self.different += 1
        return first

    def _same(self, value: _Value, old: float, new: float) -> bool:
        if old == new:
            # 0.0 and -0.0 are equal but not the same bits.
            return self._tolerance > 0.0 or math.copysign(1.0, old) == math.copysign(1.0, new)
        if old != old or new != new:
            return old != old and new != new
        if value.what != "command":
            return False
        return abs(old - new) * _PER_SI[value.unit] <= self._tolerance

    def _divergence(self, value: _Value, old: float, new: float, recorded: Sequence[float]) -> Divergence:
        tick = int(recorded[TICK])
        robot = self._layout.robots[value.robot]
        last: dict[str, Any] = {}
        if self._previous is not None:
            last = {"tick": int(self._previous[TICK]), **self._state(value.robot, self._previous)}
        return Divergence(
            tick, tick / self._layout.rate_hz, recorded[SOURCE_TIME], robot.name, value.axis, value.what,
            old, new, value.unit, last,
        )  # fmt: skip

    def _state(self, index: int, values: Sequence[float]) -> dict[str, Any]:
        """A robot's values in a tick, for the report."""
        layout = self._layout
        state: dict[str, Any] = {
            name: name_of(kind, values[layout.robot_place(index, name)])
            for name, kind in (("mode", Mode), ("fault", Fault))
        }
        for number, axis in enumerate(layout.robots[index].axes):
            state[axis] = {
                name: values[layout.axis_place(index, number, name)] for name in ("solution", "command")
            }
        return state


def _compared(layout: RecordLayout, device_units: Mapping[str, str], exact: bool) -> list[_Value]:
    """The compared values in the order of cause and effect; a tolerance compares commands and modes only."""
    out = []
    vectors = [value for value in ROBOT.values if value.about.compared and value.numbers > 1 and exact]
    states = [value for value in ROBOT.values if value.about.compared and value.numbers == 1]
    of_axis = [value for value in AXIS.values if value.about.compared and (exact or value.name == "command")]
    for index, robot in enumerate(layout.robots):
        for value in vectors:
            place = layout.robot_place(index, value.name)
            for number, letter in enumerate("xyz"):
                what = f"{value.about.compared} {letter}"
                out.append(_Value(place + number, index, "", what, _UNITS.get(value.name[-2:], "")))
        for value in of_axis:
            for number, axis in enumerate(robot.axes):
                units = {"unit": SI[robot.units[number]], "device": device_units[f"{robot.name}.{axis}"]}
                unit = next((unit for key, unit in units.items() if f"_{{{key}}}" in value.about.path), "")
                place = layout.axis_place(index, number, value.name)
                out.append(_Value(place, index, axis, value.about.compared, unit))
        for value in states:
            out.append(_Value(layout.robot_place(index, value.name), index, "", value.about.compared, ""))
    return out
