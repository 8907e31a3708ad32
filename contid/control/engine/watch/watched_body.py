"""The axes of one robot compared with its commands: one that stays outside its range is a fault.

Values are those of the devices [rad or Pa], times those of the host's clock [s], and the range of an axis is
that of `contid.control.tick.follow.expected_range`. A tick of an axis outside its range by more than its
tolerance counts 1, one inside takes `FORGIVEN` back; `CONFIRM_S` of them in sum are a fault.

While ``awake`` is above 0, each command advances the range. A tick with all axes at their commands counts it
down; at 0 commands are only noted, until an axis is off its command again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.follow.expected_range import OLDEST_S, ExpectedRange
from contid.hal import Sample

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
#: Share of its tolerance within which the range of an axis that stands still has closed.
STILL_SHARE: Final = 0.1
#: Greatest share of its tolerance for an axis that goes along while its path is slowed.
LAGGING: Final = 2.0


class Deviation(NamedTuple):
    """A fault that a comparison found, and its message."""

    fault: Fault
    message: str


@dataclass(slots=True)
class _Excursion:
    """One axis outside its range."""

    ticks: float = 0.0  # outside, less those forgiven; 0 for an axis inside
    began_at: float = 0.0  # its measurement when it was first outside
    commanded: bool = False  # its command was in motion then

    @property
    def forgiven(self) -> float:
        """The ticks after one inside."""
        return max(self.ticks - FORGIVEN, 0.0)


class WatchedBody:
    """The axes of one robot as they are watched.

    Attributes:
        config: of the robot.
        near: name of every axis, and how far from its command it is in its range, whatever that is; negative
            for one that may be too near to it.
        device: newest command [rad or Pa] while it is compared, else empty.
        behind: greatest distance of an axis from its range, as a share of its tolerance.
        grace: ticks for which an axis that goes along may be outside for longer, as its path is slowed.
        effort_share: to which the effort of its devices is limited.
        awake: ticks for which the range is kept up.
    """

    def __init__(self, config: RobotConfig) -> None:
        self.config = config
        self.near = tuple(
            (axis, -1.0 if each.least_lag_s else each.tolerance)
            for axis, each in zip(config.axes, config.responses, strict=True)
        )
        self.device: tuple[float, ...] = ()
        self.awake = 0
        self.behind = 0.0
        self.grace = 0
        self.effort_share = 1.0
        self._farthest = 0
        self._range = ExpectedRange(config.responses, config.period_s)
        self._confirm = [
            max(math.ceil((YIELDING_S if each.pushing_a < math.inf else CONFIRM_S) / config.period_s), 2)
            for each in config.responses
        ]
        self._stay = math.ceil(AWAKE_S / config.period_s)
        self._excursions = [_Excursion() for _ in config.axes]
        #: Measurements of the tick before, None where unknown; empty when all were at their commands.
        self._values: Sequence[float | None] = ()

    def note(self, device: tuple[float, ...]) -> None:
        """Take the next command of a body that is compared."""
        if self.awake:
            self._range.advance(device)
        else:
            self._range.past.append(device)
        self.device = device

    def command(self, device: tuple[float, ...], samples: Sequence[Sample]) -> None:
        """Take the first command to compare with; empty when there is none any more."""
        if not device:
            self.behind = 0.0
        else:
            values = [sample.value for sample in samples if sample.value is not None]
            self._range.begin(device, values if len(values) == len(device) else device)
            self._excursions = [_Excursion() for _ in device]
            self._values = (None,) * len(device)
            self.awake = self._stay
        self.device = device

    def rest(self) -> None:
        """Every axis is at its command."""
        self._values = ()
        self.behind = 0.0
        self.awake -= 1
        for excursion in self._excursions:
            if excursion.ticks:
                excursion.ticks = excursion.forgiven if self.awake else 0.0

    def compare(self, samples: Sequence[Sample], latest_s: float, gap: bool) -> Deviation | None:
        """Compare measurements of which one is not at its command; the first fault that they confirm.

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
            if sample.time_s > latest_s:
                ahead_s = sample.time_s - latest_s + FUTURE_S
                message = f"{self.config.axes[i]} was measured {ahead_s:.3g} s in the future"
                return Deviation(Fault.IMPLAUSIBLE_SAMPLE, message)
            if last is not None and abs(value - last) > self.config.responses[i].jump:
                ends = f"from {self._shown(i, last)} to {self._shown(i, value)}"
                message = f"{self.config.axes[i]} jumped {ends} in one tick"
                return Deviation(Fault.IMPLAUSIBLE_SAMPLE, message)
            if self._stays_outside(i, value, sample):
                commanded = self._excursions[i].commanded
                fault = Fault.DOES_NOT_FOLLOW if commanded else Fault.MOVES_UNASKED
                return Deviation(fault, self._off(i, value))
        return None

    def _stays_outside(self, axis: int, value: float, sample: Sample) -> bool:
        """True when a measurement confirms that an axis is outside its range."""
        response, excursion = self.config.responses[axis], self._excursions[axis]
        excess = self._range.excess(axis, value, sample.age_s)
        if sample.age_s > OLDEST_S or (
            excess and response.holds(self.device[axis] - value, sample.effort, self.effort_share)
        ):
            excess = 0.0
        if excess > self.behind * response.tolerance:
            self.behind, self._farthest = excess / response.tolerance, axis
        if excess <= response.tolerance:
            excursion.ticks = excursion.forgiven
            return False
        if not excursion.ticks:
            excursion.commanded = not self._range.still(axis, STILL_SHARE * response.tolerance)
            excursion.began_at = value
        excursion.ticks += 1
        may_lag = excess <= LAGGING * response.tolerance and self._goes_along(axis, value)
        return excursion.ticks >= self._confirm[axis] + (self.grace if may_lag else 0)

    def _goes_along(self, axis: int, value: float) -> bool:
        """True when an axis outside its range has moved towards its command since it left it."""
        moved = value - self._excursions[axis].began_at
        towards = moved * (self.device[axis] - value) > 0.0
        return towards and abs(moved) > STILL_SHARE * self.config.responses[axis].tolerance

    def is_near_range(self, axis: int, value: float | None) -> bool:
        """True for an axis within its tolerance of its range; also without a value, and at its command."""
        if value is None or not self.awake:
            return True
        return self._range.excess(axis, value) <= self.config.responses[axis].tolerance

    def behind_axis(self) -> tuple[str, str]:
        """Name of the axis that is farthest from its range, and where it is."""
        i = self._farthest
        value = self._values[i] if self._values else None
        return self.config.axes[i], self.config.axes[i] if value is None else self._off(i, value)

    def _off(self, axis: int, value: float) -> str:
        """Where an axis is measured, and commanded."""
        at, commanded = self._shown(axis, value), self._shown(axis, self.device[axis])
        return f"{self.config.axes[axis]} is measured at {at}, commanded {commanded}"

    def _shown(self, axis: int, value: float) -> str:
        """A device value in the unit of its column."""
        at = list(self.device)
        at[axis] = value
        quantity = self.config.quantities[axis]
        return f"{quantity.from_si(self.config.transmission.to_actuation(at)[axis]):.4g} {quantity.unit}"
