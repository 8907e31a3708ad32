"""Jerk-limited motion in actuator space, to the first row of a trajectory or to a rest pose.

Time-optimal third-order profiles, synchronised so that every axis arrives at once. Values are scaled by the
velocity limit, so that lengths [m] and pressures [Pa] suit the solver's absolute tolerances.

Source: L. Berscheid, T. Kroeger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target
States", RSS 2021 (the ruckig library).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from contid.errors import ContidError
from contid.targets import Actuation

Limit = float | Sequence[float]

#: A speed above its limit by rounding is set to the limit: the solver fails for one in eight problems where
#: several axes are a few float64 steps above it.
_ROUNDING: Final = 1e-9


class MotionError(ContidError):
    """No jerk-limited motion exists for these numbers; the message names them."""


#: Shares of the jerk limit, tried in turn. ruckig 0.19 finds no profile exactly at the border of two kinds:
#: 5 mm at 1000 mm/s^2 and 20000 mm/s^3 just reach the acceleration.
_JERKS: Final = (1.0, 1.0 - 1e-7, 1.0 - 1e-5)


class Approach:
    """A motion to a goal at rest, from a position and velocity without acceleration.

    Args:
        start: position of every axis [m or Pa].
        start_velocity: [m/s or Pa/s].
        goal: position of every axis at rest.
        velocity_limit, acceleration_limit, jerk_limit: one for all axes, or one per axis.
        straight: on a straight line from standstill, for axes with limits in common.

    Raises:
        MotionError: numbers that are not finite or limits that are not positive.
    """

    def __init__(
        self,
        start: Sequence[float],
        start_velocity: Sequence[float],
        goal: Sequence[float],
        velocity_limit: Limit,
        acceleration_limit: Limit,
        jerk_limit: Limit,
        straight: bool = False,
    ) -> None:
        import ruckig

        axes = len(start)
        limits = [per_axis(limit, axes) for limit in (velocity_limit, acceleration_limit, jerk_limit)]
        if any(not value > 0.0 for limit in limits for value in limit):
            raise MotionError(f"velocity, acceleration and jerk limits must be positive, got {limits}")
        self._goal: Actuation = tuple(float(value) for value in goal)
        self._start: Actuation = tuple(float(value) for value in start)
        self._start_velocity: Actuation = tuple(float(value) for value in start_velocity)
        self._scale = limits[0]
        problem: Any = ruckig.InputParameter(axes)
        problem.current_position = _scaled(start, self._scale)
        problem.current_velocity = [_at_most_one(v) for v in _scaled(start_velocity, self._scale)]
        problem.current_acceleration = [0.0] * axes
        problem.max_velocity = [1.0] * axes
        problem.max_acceleration = _scaled(limits[1], self._scale)
        together = ruckig.Synchronization
        problem.synchronization = together.Phase if straight else together.Time
        problem.target_velocity = [0.0] * axes
        problem.target_acceleration = [0.0] * axes
        problem.target_position = _scaled(self._goal, self._scale)
        self._trajectory: Any = ruckig.Trajectory(axes)
        for jerk in _JERKS:
            problem.max_jerk = _scaled(limits[2], [each / jerk for each in self._scale])
            try:
                result = ruckig.Ruckig(axes).calculate(problem, self._trajectory)
                break
            except Exception as error:
                if jerk == _JERKS[-1]:
                    raise MotionError(f"no motion from {list(start)} to {self._goal}: {error}") from error
        if result not in (ruckig.Result.Working, ruckig.Result.Finished):
            raise MotionError(f"no motion from {list(start)} to {self._goal}: {result.name}")
        self._duration_s: float = self._trajectory.duration

    @property
    def duration_s(self) -> float:
        """Time until every axis rests."""
        return self._duration_s

    @property
    def goal(self) -> Actuation:
        """Position at the end."""
        return self._goal

    def at(self, time_s: float) -> tuple[Actuation, Actuation]:
        """Position and velocity ``time_s`` after the start; the start before it, the goal at rest after."""
        if time_s >= self._duration_s:
            return self._goal, (0.0,) * len(self._goal)
        if time_s <= 0.0:
            return self._start, self._start_velocity
        position, velocity = self._trajectory.at_time(time_s)[:2]
        return (
            tuple([value * scale for value, scale in zip(position, self._scale, strict=True)]),
            tuple([value * scale for value, scale in zip(velocity, self._scale, strict=True)]),
        )


def per_axis(limit: Limit, axes: int) -> list[float]:
    """One limit for every axis."""
    return [float(limit)] * axes if isinstance(limit, (int, float)) else [float(value) for value in limit]


def _at_most_one(speed: float) -> float:
    return math.copysign(1.0, speed) if 1.0 < abs(speed) < 1.0 + _ROUNDING else speed


def _scaled(values: Sequence[float], scale: Sequence[float]) -> list[float]:
    return [value / by for value, by in zip(values, scale, strict=True)]
