"""Jerk-limited motion in actuator space, to the first row of a trajectory or to a rest pose.

Time-optimal third-order profiles, synchronised so that every axis arrives at once. Values are scaled by the
velocity limit, so that lengths [m] and pressures [Pa] suit the solver's absolute tolerances. A straight line
takes as long, and keeps convex limits such as a bend radius. It is compiled
(``contid/kernels/motion/rest_motion.hpp``).

Source: L. Berscheid, T. Kroeger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target
States", RSS 2021 (the ruckig library).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from contid.errors import ContidError
from contid.kernels import load
from contid.targets import Actuation
from contid.trajectory.cruise import CruiseAxis, CruiseMotion, StraightMotion
from contid.trajectory.standstill import JerkLimitedStop, JointStop, MotionState
from contid.trajectory.straight_stop import StraightStop

#: An axis is at its goal already where its way is shorter than that of this time at full speed [s]; a speed
#: below this share of its limit is zero.
_THERE: Final = 1e-8
#: A speed above its limit by this share is so by rounding.
_ROUNDING: Final = 1e-9


class MotionError(ContidError):
    """No jerk-limited motion exists for these numbers; the message names them."""


class Approach:
    """A motion to a goal at rest, from a position, velocity and acceleration.

    Args:
        start: position of every axis [m or Pa].
        start_velocity: [m/s or Pa/s].
        goal: position of every axis at rest.
        velocity_limit, acceleration_limit, jerk_limit: of every axis.
        straight: on a straight line from standstill; from motion the axes may leave it.
        start_acceleration: none by default.

    Attributes:
        duration_s: time until every axis rests.

    Raises:
        MotionError: numbers that are not finite, limits that are not above 0, or the solver finds no motion.
            From states of robots that is not known, only for limits unlike theirs: at full speed and a rising
            one, with a low jerk.
    """

    def __init__(
        self,
        start: Sequence[float],
        start_velocity: Sequence[float],
        goal: Sequence[float],
        velocity_limit: Sequence[float],
        acceleration_limit: Sequence[float],
        jerk_limit: Sequence[float],
        *,
        straight: bool = False,
        start_acceleration: Sequence[float] = (),
    ) -> None:
        self._goal: Actuation = tuple(float(value) for value in goal)
        self._start: Actuation = tuple(float(value) for value in start)
        self._start_velocity: Actuation = tuple(float(value) for value in start_velocity)
        if not all(map(math.isfinite, (*start, *start_velocity, *goal, *start_acceleration))):
            raise MotionError(f"no motion from {list(start)} to {self._goal}: they must be finite")
        if not all(0.0 < each < math.inf for each in (*velocity_limit, *acceleration_limit, *jerk_limit)):
            raise MotionError(
                f"no motion from {list(start)} to {self._goal}: limits must be above 0 and finite"
            )
        # ruckig leaves the line where the limits of the axes differ, as those of a wrist do; `cruise` has no
        # acceleration at the begin.
        limits = velocity_limit, acceleration_limit, jerk_limit
        uneven = any(len(set(limit)) > 1 for limit in limits)
        if straight and uneven and not any(start_acceleration):
            self._motion: Any = _Cruise(self._start, self._start_velocity, self._goal, limits)
        else:
            try:
                self._motion = load("limiter").RestMotion(
                    self._start, self._start_velocity, self._goal, *limits, straight, start_acceleration
                )
            except ValueError as error:
                raise MotionError(f"no motion from {self._start} to {self._goal}: {error}") from error
        self.duration_s: float = self._motion.duration

    @property
    def goal(self) -> Actuation:
        """Position of every axis at the end."""
        return self._goal

    def at(self, time_s: float) -> MotionState:
        """The state ``time_s`` after the start; the start before it, the goal at rest after."""
        if time_s >= self.duration_s:
            return MotionState(self._goal, (0.0,) * len(self._goal))
        if time_s <= 0.0:
            return MotionState(self._start, self._start_velocity)
        return MotionState(*self._motion.at_time(time_s))

    def acceleration_at(self, time_s: float) -> Actuation:
        """Acceleration of every axis ``time_s`` after the start, which is before the end."""
        found: Actuation = self._motion.acceleration_at(time_s)
        return found


class ApproachAfterStop:
    """A stop, and from its standstill an approach.

    Args:
        stop: to standstill; an approach that is nearly over is one, too.
        stop_s: how long it takes, at least.
        approach: from where the stop ends.

    Attributes:
        stop, stop_s, approach: as given.
        duration_s: time until every axis rests at the end of the approach.
    """

    def __init__(
        self, stop: Approach | JerkLimitedStop | JointStop | StraightStop, stop_s: float, approach: Approach
    ) -> None:
        self.stop = stop
        self.stop_s = stop_s
        self.approach = approach
        self.duration_s: float = stop_s + approach.duration_s

    def at(self, time_s: float) -> MotionState:
        """The state ``time_s`` after the start of the stop."""
        return self.stop.at(time_s) if time_s < self.stop_s else self.approach.at(time_s - self.stop_s)


class _Cruise:
    """A motion from rest on a straight line, else one that may leave it; it begins without acceleration."""

    def __init__(
        self, start: Actuation, velocity: Actuation, goal: Actuation, limits: Sequence[Sequence[float]]
    ) -> None:
        self._scale, *rates = limits
        ends = [_scaled(each, self._scale) for each in (start, goal)]
        there = [b if abs(a - b) <= _THERE else a for a, b in zip(*ends, strict=True)]
        speeds = [0.0 if abs(v) <= _THERE else v for v in _scaled(velocity, self._scale)]
        speeds = [math.copysign(1.0, v) if 1.0 < abs(v) < 1.0 + _ROUNDING else v for v in speeds]
        scaled = [[1.0] * len(there), *(_scaled(each, self._scale) for each in rates)]
        self._motion = (
            CruiseMotion([CruiseAxis(*each) for each in zip(there, speeds, ends[1], *scaled, strict=True)])
            if any(speeds)
            else StraightMotion(there, ends[1], scaled)
        )
        self.duration = self._motion.duration

    def at_time(self, time_s: float) -> tuple[Actuation, Actuation]:
        """Position and velocity of every axis."""
        position, velocity = self._motion.at_time(time_s)
        return (
            tuple([value * scale for value, scale in zip(position, self._scale, strict=True)]),
            tuple([value * scale for value, scale in zip(velocity, self._scale, strict=True)]),
        )

    def acceleration_at(self, time_s: float) -> Actuation:
        """Acceleration of every axis."""
        found = zip(self._motion.acceleration_at(time_s), self._scale, strict=True)
        return tuple([value * scale for value, scale in found])


def _scaled(values: Sequence[float], scale: Sequence[float]) -> list[float]:
    return [value / by for value, by in zip(values, scale, strict=True)]
