"""Jerk-limited motion of several axes to a goal that moves: the state after a time, from any state.

The motion is that of ruckig in the frame that moves with the goal at its present velocity, where the goal
rests: time-optimal, with every axis there at the same instant. Velocity limits are shifted by the velocity of
the frame; acceleration and jerk are the same in both. Its state is asked anew in every tick, from the state
before, so the motion is continuous to the acceleration and its jerk stays within its limit, whatever the goal
does.

Source: L. Berscheid, T. Kroeger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target
States", RSS 2021 (the ruckig library).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, Final, NamedTuple

from contid.targets import Actuation

#: Share of the velocity limit that a frame moves at most: the axes can still come nearer.
_FRAME_SHARE: Final = 0.95
#: Shares of the jerk limit, tried in turn: ruckig 0.19 finds no profile exactly at the border of two kinds.
_JERKS: Final = (1.0 - 1e-6, 1.0 - 1e-4, 1.0 - 1e-2)
#: Values below this share of the velocity limit, in its units, are rounding.
_NONE: Final = 1e-9


class MovingAxes(NamedTuple):
    """Position [m or Pa], velocity [1/s] and acceleration [1/s^2] of every axis."""

    position: Actuation
    velocity: Actuation
    acceleration: Actuation


class AxisRates(NamedTuple):
    """Greatest velocity, acceleration and jerk of every axis [1/s, 1/s^2, 1/s^3]."""

    velocity: Sequence[float]
    acceleration: Sequence[float]
    jerk: Sequence[float]


@cache
def _solver(axes: int) -> tuple[Any, Any, Any]:
    """Ruckig for a number of axes, its input and its output."""
    import ruckig

    asked: Any = ruckig.InputParameter(axes)
    asked.target_position = asked.target_velocity = asked.target_acceleration = [0.0] * axes
    return ruckig.Ruckig(axes), asked, ruckig.Trajectory(axes)


def frame_velocity(pace: Sequence[float], rates: AxisRates) -> Actuation:
    """Velocity of the frame of a goal that moves by a pace [1/s]; 0 for all axes where one has jumped."""
    if any(abs(v) > limit for v, limit in zip(pace, rates.velocity, strict=True)):
        return (0.0,) * len(pace)
    pairs = zip(pace, rates.velocity, strict=True)
    return tuple([min(max(v, -_FRAME_SHARE * limit), _FRAME_SHARE * limit) for v, limit in pairs])


def pursued(
    state: MovingAxes,
    goal: Actuation,
    frame: Actuation,
    rates: AxisRates,
    time_s: float,
    together: bool = True,
) -> MovingAxes | None:
    """The state after ``time_s`` on the way to a goal; None where ruckig finds no motion.

    Args:
        state: now.
        goal: where the goal will be after ``time_s``, if it goes on.
        frame: its velocity (`frame_velocity`).
        rates: limits of the axes.
        time_s: a tick.
        together: every axis arrives at the same instant, else each as early as it can.
    """
    import ruckig

    gaps = zip(state.position, goal, frame, strict=True)
    found = _planned(
        [at - there + v * time_s for at, there, v in gaps],
        state,
        frame,
        rates,
        ruckig.ControlInterface.Position,
        ruckig.Synchronization.Phase if together else ruckig.Synchronization.No,
    )
    return None if found is None else _at(found, time_s, goal, frame, rates)


def stopping(state: MovingAxes, rates: AxisRates, times: int) -> list[MovingAxes]:
    """States at equal times of the shortest stop together, the last at rest; none where ruckig finds none."""
    found = _stop(state, rates, together=True)
    if found is None:
        return []
    still = (0.0,) * len(state.position)
    ways = [_at(found, found.duration * (k + 1) / times, state.position, still, rates) for k in range(times)]
    return [way for way in ways if way is not None]


def braked(state: MovingAxes, rates: AxisRates, time_s: float, together: bool) -> MovingAxes | None:
    """The state after ``time_s`` of the shortest stop, ``together`` or of every axis by itself."""
    found = _stop(state, rates, together)
    still = (0.0,) * len(state.position)
    return None if found is None else _at(found, time_s, state.position, still, rates)


def _stop(state: MovingAxes, rates: AxisRates, together: bool) -> Any:
    import ruckig

    kind = ruckig.Synchronization.Time if together else ruckig.Synchronization.No
    still = (0.0,) * len(state.position)
    return _planned(still, state, still, rates, ruckig.ControlInterface.Velocity, kind)


def _planned(
    gaps: Sequence[float], state: MovingAxes, frame: Actuation, rates: AxisRates, interface: Any, kind: Any
) -> Any:
    """The motion of ruckig from a state to rest in a frame, None where it finds none."""
    import ruckig

    solver, asked, trajectory = _solver(len(frame))
    scale = rates.velocity
    asked.control_interface, asked.synchronization = interface, kind
    asked.current_position = [_rounded(gap / unit) for gap, unit in zip(gaps, scale, strict=True)]
    speeds = zip(state.velocity, frame, scale, strict=True)
    asked.current_velocity = [_rounded((speed - v) / unit) for speed, v, unit in speeds]
    asked.current_acceleration = [_rounded(a / b) for a, b in zip(state.acceleration, scale, strict=True)]
    asked.max_velocity = [1.0 - v / unit for v, unit in zip(frame, scale, strict=True)]
    asked.min_velocity = [-1.0 - v / unit for v, unit in zip(frame, scale, strict=True)]
    asked.max_acceleration = [a / b for a, b in zip(rates.acceleration, scale, strict=True)]
    for share in _JERKS:
        asked.max_jerk = [share * j / unit for j, unit in zip(rates.jerk, scale, strict=True)]
        try:
            result = solver.calculate(asked, trajectory)
        except Exception:  # no profile found
            continue
        if result in (ruckig.Result.Working, ruckig.Result.Finished):
            return trajectory
    return None


def _at(
    motion: Any, time_s: float, origin: Actuation, frame: Actuation, rates: AxisRates
) -> MovingAxes | None:
    """The state of a motion at a time; None for one that is not finite."""
    position, velocity, acceleration = motion.at_time(time_s)[:3]
    if not all(map(math.isfinite, (*position, *velocity, *acceleration))):
        return None
    scale = rates.velocity
    return MovingAxes(
        tuple([there + e * unit for there, e, unit in zip(origin, position, scale, strict=True)]),
        tuple([v + e * unit for v, e, unit in zip(frame, velocity, scale, strict=True)]),
        tuple([a * unit for a, unit in zip(acceleration, scale, strict=True)]),
    )


def _rounded(value: float) -> float:
    return 0.0 if abs(value) < _NONE else value
