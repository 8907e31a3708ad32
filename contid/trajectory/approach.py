"""Jerk-limited motion in actuator space, to the first row of a trajectory or to a rest pose.

Time-optimal third-order profiles, synchronised so that every axis arrives at once. Values are scaled by the
velocity limit, so that lengths [m] and pressures [Pa] suit the solver's absolute tolerances. A straight line
takes as long, and keeps convex limits such as a bend radius. Without ruckig, which has no wheel for some
machines, `contid.trajectory.cruise` takes its place.

Source: L. Berscheid, T. Kroeger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target
States", RSS 2021 (the ruckig library).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, Final

from contid.errors import ContidError
from contid.targets import Actuation
from contid.trajectory.cruise import CruiseAxis, CruiseMotion, StraightMotion

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
        straight: on a straight line from standstill.

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
        axes = len(start)
        limits = [per_axis(limit, axes) for limit in (velocity_limit, acceleration_limit, jerk_limit)]
        if any(not value > 0.0 for limit in limits for value in limit):
            raise MotionError(f"velocity, acceleration and jerk limits must be positive, got {limits}")
        self._goal: Actuation = tuple(float(value) for value in goal)
        self._start: Actuation = tuple(float(value) for value in start)
        self._start_velocity: Actuation = tuple(float(value) for value in start_velocity)
        self._scale = limits[0]
        if not all(map(math.isfinite, (*start, *start_velocity, *goal))):
            raise MotionError(f"no motion from {list(start)} to {self._goal}: they must be finite")
        scaled = (
            _scaled(start, self._scale),
            [_at_most_one(v) for v in _scaled(start_velocity, self._scale)],
            _scaled(self._goal, self._scale),
            _scaled(limits[1], self._scale),
        )
        # ruckig leaves the line where the limits of the axes differ, as those of a wrist do.
        uneven = straight and any(len(set(limit)) > 1 for limit in limits)
        solve = _optimal if optimal() and not uneven else _cruising
        self._trajectory: Any = solve(*scaled, limits[2], self._scale, straight)
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


@cache
def optimal() -> bool:
    """True if motions are those of ruckig, False if the package is missing."""
    try:
        import ruckig  # noqa: F401
    except ImportError:
        return False
    return True


def _optimal(
    start: list[float],
    velocity: list[float],
    goal: list[float],
    acceleration_limit: list[float],
    jerk_limit: list[float],
    scale: list[float],
    straight: bool,
) -> Any:
    """The motion of ruckig; all but the jerk is scaled already."""
    import ruckig

    axes = len(start)
    problem: Any = ruckig.InputParameter(axes)
    problem.current_position, problem.current_velocity = start, velocity
    problem.current_acceleration = problem.target_velocity = problem.target_acceleration = [0.0] * axes
    problem.max_velocity, problem.max_acceleration = [1.0] * axes, acceleration_limit
    together = ruckig.Synchronization
    problem.synchronization = together.Phase if straight else together.Time
    problem.target_position = goal
    trajectory: Any = ruckig.Trajectory(axes)
    for share in _JERKS:
        problem.max_jerk = _scaled(jerk_limit, [each / share for each in scale])
        try:
            result = ruckig.Ruckig(axes).calculate(problem, trajectory)
            break
        except Exception as error:
            if share == _JERKS[-1]:
                raise MotionError(f"no motion from {start} to {goal}: {error}") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise MotionError(f"no motion from {start} to {goal}: {result.name}")
    return trajectory


def _cruising(
    start: list[float],
    velocity: list[float],
    goal: list[float],
    acceleration_limit: list[float],
    jerk_limit: list[float],
    scale: list[float],
    straight: bool,
) -> CruiseMotion | StraightMotion:
    """The motion without ruckig; all but the jerk is scaled already."""
    limits = [[1.0] * len(start), acceleration_limit, _scaled(jerk_limit, scale)]
    if straight and not any(velocity):
        return StraightMotion(start, goal, limits)
    return CruiseMotion([CruiseAxis(*each) for each in zip(start, velocity, goal, *limits, strict=True)])


def per_axis(limit: Limit, axes: int) -> list[float]:
    """One limit for every axis."""
    return [float(limit)] * axes if isinstance(limit, (int, float)) else [float(value) for value in limit]


def _at_most_one(speed: float) -> float:
    return math.copysign(1.0, speed) if 1.0 < abs(speed) < 1.0 + _ROUNDING else speed


def _scaled(values: Sequence[float], scale: Sequence[float]) -> list[float]:
    return [value / by for value, by in zip(values, scale, strict=True)]
