"""The body of one robot, compared with its commands (`contid.control.engine.watch.body_watch`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.follow.expected_range import OLDEST_S, ExpectedRange
from contid.hal import Sample
from contid.robot_file.base import Quantity

#: Time that an axis may be outside its range.
CONFIRM_S: Final = 0.02
#: The same for one that yields to what it pushes on: its current follows its error.
YIELDING_S: Final = 0.1
#: Share of a tick outside that one inside takes back: a reading that is wrong every other time is confirmed.
FORGIVEN: Final = 0.125
#: A measurement dated farther ahead than this is from the future.
FUTURE_S: Final = 0.1
#: How long a range is kept up after the last axis was off its command.
AWAKE_S: Final = 0.5
#: Least time that the axes have to arrive after the last command, and the same in their longest lag.
SETTLE_S: Final = 0.5
SETTLE_LAGS: Final = 5.0
#: Share of its tolerance within which the range of an axis that stands still has closed.
STILL_SHARE: Final = 0.1
#: Greatest share of its tolerance for an axis that goes along while its path is slowed.
LAGGING: Final = 2.0


@dataclass(frozen=True, slots=True)
class AxisPlace:
    """Where an axis was commanded to, and measured, in the unit of its column.

    Attributes:
        axis: its column, such as ``left_mm``.
        commanded, measured: the values.
        arrived: the measurement is within the tolerance of the command, or the axis holds.
        holds: it is not, but pushes on something that it may yield to.
    """

    axis: str
    commanded: float
    measured: float
    arrived: bool
    holds: bool = False

    def __str__(self) -> str:
        """For a person."""
        off = self.measured - self.commanded
        held = ", pushes on something" if self.holds else ""
        return (
            f"{self.axis} commanded {self.commanded:.4g}, measured {self.measured:.4g}, off {off:+.3g}{held}"
        )


def has_arrived(places: Sequence[AxisPlace]) -> bool:
    """True when every axis is within the tolerance of its command."""
    return all(place.arrived for place in places)


class WatchedBody:
    """The axes of one robot as they are watched.

    Attributes:
        config: of the robot.
        checks: name and tolerance of every axis.
        near: name of every axis, and how far from its command it is in its range, whatever that is; negative
            for one that may be too near to it.
        goal: newest command [rad or Pa]; empty before the first.
        device: the same while it is compared, else empty.
        behind: greatest distance of an axis from its range, as a share of its tolerance.
        grace: ticks for which an axis that goes along may be outside for longer, as its path is slowed.
        effort_share: to which the effort of its devices is limited.
        awake: ticks for which the range is kept up.
        note: takes a command of a tick in which it is not.
        settle_s: how long the axes may take to arrive after the last command [s].
        last: where the axes were at the end of the last motion; None while the robot is commanded.
        settles_s: until when they may arrive there, None when that is decided.
    """

    def __init__(self, config: RobotConfig) -> None:
        self.config = config
        self.checks = tuple(
            (axis, response.tolerance) for axis, response in zip(config.axes, config.responses, strict=True)
        )
        self.near = tuple(
            (axis, -1.0 if each.least_lag_s else each.tolerance)
            for axis, each in zip(config.axes, config.responses, strict=True)
        )
        slowest_s = max(each.delay_s + SETTLE_LAGS * each.lag_s for each in config.responses)
        self.settle_s = max(slowest_s, SETTLE_S)
        self.goal: tuple[float, ...] = ()
        self.device: tuple[float, ...] = ()
        self.awake = 0
        self.behind = 0.0
        self.grace = 0
        self.effort_share = 1.0
        self._farthest = 0
        #: Where an axis was when it was first outside.
        self._left_at = [0.0] * len(config.axes)
        self.last: list[AxisPlace] | None = None
        self.settles_s: float | None = None
        self._range = ExpectedRange(config.responses, config.period_s)
        self.note = self._range.past.append
        self._confirm = [
            max(math.ceil((YIELDING_S if each.pushing_a < math.inf else CONFIRM_S) / config.period_s), 2)
            for each in config.responses
        ]
        self._stay = math.ceil(AWAKE_S / config.period_s)
        self._outside = [0.0] * len(config.axes)
        #: Axes that were on their way when the devices took no more commands, and need not arrive.
        self._on_way: list[bool] = []
        self._asked = [False] * len(config.axes)
        #: Measurements of the tick before, None where unknown; empty when all were at their commands.
        self._values: Sequence[float | None] = ()

    def command(self, device: tuple[float, ...], samples: Sequence[Sample]) -> None:
        """Take a command to compare with; empty when there is none."""
        if device and not self.device:
            values = [sample.value for sample in samples if sample.value is not None]
            self._range.begin(device, values if len(values) == len(device) else device)
            self._outside = [0.0] * len(device)
            self._values = (None,) * len(device)
            self.awake = self._stay
        elif device and self.awake:
            self._range.advance(device)
        if not device:
            self.behind = 0.0
        self.device = device

    def compare(self, samples: Sequence[Sample], latest_s: float, gap: bool) -> tuple[Fault, str]:
        """Compare measurements of which one is not at its command; the fault and its message, or none.

        Args:
            samples: of every axis.
            latest_s: time after which a measurement is from the future.
            gap: ticks were left out since the measurements before.
        """
        if not self.awake:
            self._range.catch_up()
        self.awake = self._stay
        before = (None,) * len(samples) if gap else self._values or self.device
        self.behind = 0.0
        self._values = [each.value if each.valid and not each.fault else None for each in samples]
        for i, (value, last, sample) in enumerate(zip(self._values, before, samples, strict=True)):
            if value is None:
                continue
            response, axis = self.config.responses[i], self.config.axes[i]
            if sample.time_s > latest_s:
                ahead_s = sample.time_s - latest_s + FUTURE_S
                return Fault.IMPLAUSIBLE_SAMPLE, f"{axis} was measured {ahead_s:.3g} s in the future"
            if last is not None and abs(value - last) > response.jump:
                shown = f"{axis} jumped from {self._edge(i, last)} to {self._edge(i, value)} in one tick"
                return Fault.IMPLAUSIBLE_SAMPLE, shown
            excess = self._range.excess(i, value, sample.age_s)
            if sample.age_s > OLDEST_S or (
                excess and response.holds(self.device[i] - value, sample.effort, self.effort_share)
            ):
                excess = 0.0
            if excess > self.behind * response.tolerance:
                self.behind, self._farthest = excess / response.tolerance, i
            if excess <= response.tolerance:
                self._outside[i] = max(self._outside[i] - FORGIVEN, 0.0)
                continue
            if not self._outside[i]:
                self._asked[i] = not self._range.still(i, STILL_SHARE * response.tolerance)
                self._left_at[i] = value
            self._outside[i] += 1
            wait = self.grace if excess <= LAGGING * response.tolerance and self._goes_along(i, value) else 0
            if self._outside[i] >= self._confirm[i] + wait:
                fault = Fault.DOES_NOT_FOLLOW if self._asked[i] else Fault.MOVES_UNASKED
                return fault, self._off(i, value)
        return Fault.NONE, ""

    def _goes_along(self, axis: int, value: float) -> bool:
        """True when an axis outside its range has moved towards its command since it left it."""
        way = value - self._left_at[axis]
        return way * (self.device[axis] - value) > 0.0 and abs(way) > STILL_SHARE * self.checks[axis][1]

    def behind_axis(self) -> tuple[str, str]:
        """Name of the axis that is farthest from its range, and where it is."""
        i = self._farthest
        value = self._values[i] if self._values else None
        return self.config.axes[i], self.config.axes[i] if value is None else self._off(i, value)

    def leave(self, samples: Sequence[Sample], holds: bool, now_s: float) -> None:
        """The devices take no commands from now on.

        Devices that hold their goal may still arrive at it; others had to be on their way: those that relax,
        and regulators, which close their valves where the pressure is. A robot that closes on an object was
        not compared.
        """
        self._on_way = [not self.device] * len(self.checks)
        for i, (quantity, sample) in enumerate(zip(self.config.quantities, samples, strict=True)):
            if not holds or quantity is Quantity.PRESSURE:
                at, tolerance = sample.value, self.checks[i][1]
                self._on_way[i] |= at is None or not self.awake or self._range.excess(i, at) <= tolerance
        self.last = self._left(samples)
        if holds and not (self.last and has_arrived(self.last)):
            self.settles_s = now_s + self.settle_s

    def settle(self, samples: Sequence[Sample], now_s: float) -> None:
        """Decide whether the axes arrived, once they did or their time is over."""
        assert self.settles_s is not None
        self.last = self._left(samples) or self.last
        if (self.last and has_arrived(self.last)) or now_s >= self.settles_s:
            self.settles_s = None

    def _left(self, samples: Sequence[Sample]) -> list[AxisPlace]:
        """The places of the axes, of which some had only to be on their way."""
        return [
            replace(place, arrived=place.arrived or on_way)
            for place, on_way in zip(self.places(samples), self._on_way, strict=False)
        ]

    def rest(self) -> None:
        """Every axis is at its command."""
        self._values = ()
        self.behind = 0.0
        self.awake -= 1
        self._outside = (
            [max(count - FORGIVEN, 0.0) for count in self._outside]
            if self.awake
            else [0.0] * len(self.checks)
        )

    def places(self, samples: Sequence[Sample]) -> list[AxisPlace]:
        """Command and last measurement of every axis; empty before the first of both.

        An axis that is not there has not arrived by a read that failed, which keeps the value before it.
        """
        config, device = self.config, self.goal
        values = [each.value for each in samples if each.value is not None and math.isfinite(each.value)]
        if not device or len(values) < len(device):
            return []
        measured = config.transmission.to_actuation(values)
        commanded = config.transmission.to_actuation(device)
        out = []
        columns = zip(config.axis_names, config.quantities, strict=True)
        axes = zip(columns, commanded, measured, device, samples, config.responses, strict=True)
        for (name, quantity), goal, at, want, sample, response in axes:
            off = 0.0 if sample.value is None else want - sample.value
            near = abs(off) <= response.tolerance
            holds = not near and response.holds(off, sample.effort, self.effort_share)
            column = f"{name}_{quantity.unit}"
            out.append(AxisPlace(column, quantity.from_si(goal), quantity.from_si(at), near or holds, holds))
        return out

    def _off(self, axis: int, value: float) -> str:
        """Where an axis is measured, and commanded."""
        at, asked = self._edge(axis, value), self._edge(axis, self.device[axis])
        return f"{self.config.axes[axis]} is measured at {at}, commanded {asked}"

    def _edge(self, axis: int, value: float) -> str:
        """A device value in the unit of its column."""
        at = list(self.device)
        at[axis] = value
        quantity = self.config.quantities[axis]
        return f"{quantity.from_si(self.config.transmission.to_actuation(at)[axis]):.4g} {quantity.unit}"
