"""Jerk-limited motion of several axes to a goal that moves: the state after a time, from any state.

The motion is that of ruckig in the frame that moves with the goal at its present velocity, where the goal
rests: time-optimal, with every axis there at the same instant. Velocity limits are shifted by the velocity of
the frame; acceleration and jerk are the same in both. Its state is asked anew in every tick, from the state
before, so the motion is continuous to the acceleration and its jerk stays within its limit, whatever the goal
does.

`contid.trajectory.planned_motion` plans the motion in the frame, on a straight line where it may.

Source: L. Berscheid, T. Kroeger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target
States", RSS 2021 (the ruckig library).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from contid.targets import Actuation
from contid.trajectory.planned_motion import (
    AxisRates,
    Lines,
    MovingAxes,
    planned,
    rounded,
    shares_of_line,
    state_at,
)

#: Share of the velocity limit that a frame moves at most: the axes can still come nearer.
_FRAME_SHARE: Final = 0.95


def frame_velocity(pace: Sequence[float], rates: AxisRates) -> Actuation:
    """Velocity of the frame of a goal that moves by a pace [m/s or Pa/s]; 0 where an axis has jumped."""
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
    *,
    straight: Lines = Lines.NONE,
) -> MovingAxes | None:
    """The state after ``time_s`` on the way to a goal; None where ruckig finds no motion.

    Args:
        state: now.
        goal: where the goal will be after ``time_s``, if it goes on.
        frame: its velocity (`frame_velocity`).
        rates: limits of the axes.
        time_s: a tick.
        together: every axis arrives at the same instant, else each as early as it can.
        straight: the straight line where the present rates allow it, with ``together``.
    """
    import ruckig

    gaps = zip(state.position, goal, frame, strict=True)
    found = planned(
        [at - there + v * time_s for at, there, v in gaps],
        state,
        frame,
        rates,
        ruckig.ControlInterface.Position,
        ruckig.Synchronization.Phase if together else ruckig.Synchronization.No,
        straight=straight,
    )
    return None if found is None else state_at(found, time_s, goal, frame, rates)


def kept_line(
    state: MovingAxes, goal: Actuation, rates: AxisRates, time_s: float, straight: Lines
) -> MovingAxes | None:
    """The state after ``time_s`` on the straight line of the present motion, to its point nearest to a goal.

    None where the axes are not on a line.
    """
    scale = rates.velocity
    velocity = rounded([v / unit for v, unit in zip(state.velocity, scale, strict=True)])
    acceleration = rounded([a / unit for a, unit in zip(state.acceleration, scale, strict=True)])
    most = [a / unit for a, unit in zip(rates.acceleration, scale, strict=True)]
    shares = shares_of_line(velocity, velocity, acceleration, most)
    if not shares:
        return None
    gaps = zip(shares, goal, state.position, scale, strict=True)
    way = sum([share * (there - at) / unit for share, there, at, unit in gaps]) / sum([s * s for s in shares])
    ends = zip(state.position, shares, scale, strict=True)
    end = tuple([at + way * share * unit for at, share, unit in ends])
    return pursued(state, end, (0.0,) * len(end), rates, time_s, straight=straight)


def braked(
    state: MovingAxes, rates: AxisRates, time_s: float, together: bool, straight: Lines = Lines.NONE
) -> MovingAxes | None:
    """The state after ``time_s`` of the shortest stop, ``together`` or of every axis by itself."""
    found = _stop(state, rates, together, straight)
    still = (0.0,) * len(state.position)
    return None if found is None else state_at(found, time_s, state.position, still, rates)


def _stop(state: MovingAxes, rates: AxisRates, together: bool, straight: Lines) -> Any:
    import ruckig

    kind = ruckig.Synchronization.Time if together else ruckig.Synchronization.No
    still = (0.0,) * len(state.position)
    return planned(still, state, still, rates, ruckig.ControlInterface.Velocity, kind, straight=straight)
