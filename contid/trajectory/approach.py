"""Jerk-limited motion in actuator space: the way to the first row, to a rest pose, and to a standstill.

Time-optimal third-order profiles, synchronised so that every axis arrives at once. Values are scaled by the
velocity limit before they reach the solver, so lengths in metres and pressures in pascals are equally well
conditioned for its absolute tolerances.

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

#: A speed so little above its limit is the limit, rounded. The solver finds no way for several axes that are
#: all a few float64 steps above it (one in eight of such problems); it does for the limit itself.
_ROUNDING: Final = 1e-9


class MotionError(ContidError):
    """No jerk-limited motion exists for these numbers; the message says which were not usable."""


class Approach:
    """A motion from a state to a goal at rest.

    Args:
        start: where every axis is [m or Pa].
        start_velocity: how fast every axis moves now [m/s or Pa/s].
        goal: where every axis shall rest.
        velocity_limit, acceleration_limit, jerk_limit: one for all axes, or one per axis.
        start_acceleration: zero when left out.

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
        start_acceleration: Sequence[float] | None = None,
    ) -> None:
        self._goal: Actuation | None = tuple(float(value) for value in goal)
        self._solve(start, start_velocity, start_acceleration, velocity_limit, acceleration_limit, jerk_limit)

    @property
    def duration_s(self) -> float:
        """Time until every axis rests."""
        return self._duration_s

    @property
    def goal(self) -> Actuation:
        """Where the motion ends."""
        return self.at(self._duration_s)[0]

    def at(self, time_s: float) -> tuple[Actuation, Actuation]:
        """Position and velocity ``time_s`` after the start; the start before it, the goal at rest after."""
        if time_s >= self._duration_s and self._goal is not None:
            return self._goal, (0.0,) * len(self._goal)
        if time_s <= 0.0:
            return self._start, self._start_velocity
        position, velocity = self._trajectory.at_time(min(time_s, self._duration_s))[:2]
        return (
            tuple([value * scale for value, scale in zip(position, self._scale, strict=True)]),
            tuple([value * scale for value, scale in zip(velocity, self._scale, strict=True)]),
        )

    def _solve(
        self,
        start: Sequence[float],
        start_velocity: Sequence[float],
        start_acceleration: Sequence[float] | None,
        velocity_limit: Limit,
        acceleration_limit: Limit,
        jerk_limit: Limit,
    ) -> None:
        import ruckig

        axes = len(start)
        limits = [per_axis(limit, axes) for limit in (velocity_limit, acceleration_limit, jerk_limit)]
        if any(not value > 0.0 for limit in limits for value in limit):
            raise MotionError(f"velocity, acceleration and jerk limits must be positive, got {limits}")
        self._start: Actuation = tuple(float(value) for value in start)
        self._start_velocity: Actuation = tuple(float(value) for value in start_velocity)
        self._scale = limits[0]
        problem: Any = ruckig.InputParameter(axes)
        problem.current_position = _scaled(start, self._scale)
        problem.current_velocity = _scaled(start_velocity, self._scale)
        problem.current_acceleration = _scaled(start_acceleration or (0.0,) * axes, self._scale)
        problem.max_velocity = [1.0] * axes
        problem.max_acceleration = _scaled(limits[1], self._scale)
        problem.max_jerk = _scaled(limits[2], self._scale)
        problem.synchronization = ruckig.Synchronization.Time
        problem.target_velocity = [0.0] * axes
        problem.target_acceleration = [0.0] * axes
        if self._goal is None:
            problem.control_interface = ruckig.ControlInterface.Velocity
        else:
            problem.target_position = _scaled(self._goal, self._scale)
            problem.current_velocity = [_at_most_one(value) for value in problem.current_velocity]
        self._trajectory: Any = ruckig.Trajectory(axes)
        try:
            result = ruckig.Ruckig(axes).calculate(problem, self._trajectory)
        except Exception as error:
            raise MotionError(f"no motion from {list(start)} to {self._goal}: {error}") from error
        if result not in (ruckig.Result.Working, ruckig.Result.Finished):
            raise MotionError(f"no motion from {list(start)} to {self._goal}: {result.name}")
        self._duration_s: float = self._trajectory.duration


def per_axis(limit: Limit, axes: int) -> list[float]:
    """One limit for every axis."""
    return [float(limit)] * axes if isinstance(limit, (int, float)) else [float(value) for value in limit]


def _at_most_one(speed: float) -> float:
    return math.copysign(1.0, speed) if 1.0 < abs(speed) < 1.0 + _ROUNDING else speed


def _scaled(values: Sequence[float], scale: Sequence[float]) -> list[float]:
    return [value / by for value, by in zip(values, scale, strict=True)]
