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
from typing import Any, Final, NamedTuple

from contid.errors import ContidError
from contid.targets import Actuation
from contid.trajectory.cruise import CruiseAxis, CruiseMotion, StraightMotion
from contid.trajectory.standstill import MotionState

#: A speed above its limit by rounding is set to the limit: the solver fails for one in eight problems where
#: several axes are a few float64 steps above it.
_ROUNDING: Final = 1e-9


#: An axis is at its goal already where its way is shorter than that of this time at full speed [s]; a speed
#: below this share of its limit, and an acceleration below it in the same scaled unit, are zero. For some of
#: such values the solver finds no motion, and for others one away from the goal and back.
_THERE: Final = 1e-8


class MotionError(ContidError):
    """No jerk-limited motion exists for these numbers; the message names them."""


#: Shares of the jerk limit, tried in turn. ruckig 0.19 finds no profile exactly at the border of two kinds:
#: 5 mm at 1000 mm/s^2 and 20000 mm/s^3 just reach the acceleration.
_JERKS: Final = (1.0, 1.0 - 1e-7, 1.0 - 1e-5)


class Approach:
    """A motion to a goal at rest, from a position, velocity and acceleration.

    Args:
        start: position of every axis [m or Pa].
        start_velocity: [m/s or Pa/s].
        goal: position of every axis at rest.
        velocity_limit, acceleration_limit, jerk_limit: of every axis.
        straight: on a straight line from standstill; from motion the axes may leave it.
        start_acceleration: none by default; without ruckig it counts as none.

    Attributes:
        duration_s: time until every axis rests.

    Raises:
        MotionError: numbers that are not finite, or the solver finds no motion. From states of robots that is
            not known, only for limits unlike theirs: at full speed and a rising one, with a low jerk.
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
        self._scale = velocity_limit
        if not all(map(math.isfinite, (*start, *start_velocity, *goal))):
            raise MotionError(f"no motion from {list(start)} to {self._goal}: they must be finite")
        scaled_goal = _scaled(goal, self._scale)
        problem = _Problem(
            [
                there if abs(here - there) <= _THERE else here
                for here, there in zip(_scaled(start, self._scale), scaled_goal, strict=True)
            ],
            [_known_speed(v) for v in _scaled(start_velocity, self._scale)],
            _known_accelerations(start_acceleration, acceleration_limit, self._scale),
            scaled_goal,
            *(_scaled(each, self._scale) for each in (acceleration_limit, jerk_limit)),
        )
        # ruckig leaves the line where the limits of the axes differ, as those of a wrist do.
        limits = velocity_limit, acceleration_limit, jerk_limit
        # `_cruising` takes no acceleration into account, so one that is there needs ruckig.
        unaccelerated = not any(start_acceleration)
        uneven = straight and unaccelerated and any(len(set(limit)) > 1 for limit in limits)
        solve = _optimal if optimal() and not uneven else _cruising
        self._trajectory: Any = solve(problem, straight)
        self.duration_s: float = self._trajectory.duration

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
        position, velocity = self._trajectory.at_time(time_s)[:2]
        return MotionState(
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


class _Problem(NamedTuple):
    """A motion to be found; everything is scaled, so that the velocity limit of every axis is 1."""

    start: list[float]
    velocity: list[float]
    acceleration: list[float]
    goal: list[float]
    acceleration_limit: list[float]
    jerk_limit: list[float]


def _optimal(problem: _Problem, straight: bool) -> Any:
    """The motion of ruckig."""
    import ruckig

    axes = len(problem.start)
    asked: Any = ruckig.InputParameter(axes)
    asked.current_position, asked.current_velocity = problem.start, problem.velocity
    asked.current_acceleration = problem.acceleration
    asked.target_velocity = asked.target_acceleration = [0.0] * axes
    asked.max_velocity, asked.max_acceleration = [1.0] * axes, problem.acceleration_limit
    # Phase: all axes have the same profile but for a factor each, which is a straight line; ruckig falls back
    # to Time where there is none. Time: they only arrive together.
    asked.synchronization = ruckig.Synchronization.Phase if straight else ruckig.Synchronization.Time
    asked.target_position = problem.goal
    trajectory: Any = ruckig.Trajectory(axes)
    between = f"no motion from {problem.start} to {problem.goal}"
    for share in _JERKS:
        asked.max_jerk = [share * each for each in problem.jerk_limit]
        try:
            result = ruckig.Ruckig(axes).calculate(asked, trajectory)
            break
        except Exception as error:
            if share == _JERKS[-1]:
                raise MotionError(f"{between}: {error}") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise MotionError(f"{between}: {result.name}")
    return trajectory


def _cruising(problem: _Problem, straight: bool) -> CruiseMotion | StraightMotion:
    """The motion without ruckig."""
    start, velocity, _, goal, *limits = problem
    limits = [[1.0] * len(start), *limits]
    if straight and not any(velocity):
        return StraightMotion(start, goal, limits)
    return CruiseMotion([CruiseAxis(*each) for each in zip(start, velocity, goal, *limits, strict=True)])


def _known_speed(speed: float) -> float:
    """A scaled speed without the rounding at 0 and at the limit."""
    if abs(speed) <= _THERE:
        return 0.0
    return math.copysign(1.0, speed) if 1.0 < abs(speed) < 1.0 + _ROUNDING else speed


def _known_accelerations(
    values: Sequence[float], most: Sequence[float], scale: Sequence[float]
) -> list[float]:
    """Scaled accelerations within their limits, without rounding at 0."""
    if not any(values):
        return [0.0] * len(scale)
    bounded = [min(max(value, -limit), limit) for value, limit in zip(values, most, strict=True)]
    return [0.0 if abs(each) <= _THERE else each for each in _scaled(bounded, scale)]


def _scaled(values: Sequence[float], scale: Sequence[float]) -> list[float]:
    return [value / by for value, by in zip(values, scale, strict=True)]
