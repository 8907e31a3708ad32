"""Jerk-limited motion of several axes to a goal that moves: the state after a time, from any state.

The motion is that of ruckig in the frame that moves with the goal at its present velocity, where the goal
rests: time-optimal, with every axis there at the same instant. Velocity limits are shifted by the velocity of
the frame; acceleration and jerk are the same in both. Its state is asked anew in every tick, from the state
before, so the motion is continuous to the acceleration and its jerk stays within its limit, whatever the goal
does.

Axes whose present rates already lead to the goal, or that stop from such, stay on the straight line to it:
the motion of one axis, with the limits that bind first, is theirs by shares. Ruckig itself finds that only
where the rates are parallel to the last bit.

Source: L. Berscheid, T. Kroeger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target
States", RSS 2021 (the ruckig library).
"""

from __future__ import annotations

import enum
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
#: Rates are parallel to a way within this share of their limits.
_PARALLEL: Final = 1e-9


class Lines(enum.IntEnum):
    """Straight lines of axes whose present rates allow them, by versions of the rules of motions.

    ROUNDED leads past the goal by what is rounded of the way of an axis, a share of `_NONE` of its speed. To
    a goal on a limit that axes share such a line led 3e-12 m beyond the limit. EXACT leads to the goal, and
    takes no way of an axis in motion for zero, which was a step of up to 2e-4 Pa.
    """

    NONE = 0
    ROUNDED = 1
    EXACT = 2

    @classmethod
    def of(cls, motion_rules: int) -> Lines:
        """Those of `contid.control.tick.config.MOTION_RULES`, or of the recording that is replayed."""
        return cls(max(0, min(motion_rules - 1, cls.EXACT)))


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
    found = _planned(
        [at - there + v * time_s for at, there, v in gaps],
        state,
        frame,
        rates,
        ruckig.ControlInterface.Position,
        ruckig.Synchronization.Phase if together else ruckig.Synchronization.No,
        straight=straight,
    )
    return None if found is None else _at(found, time_s, goal, frame, rates)


def kept_line(
    state: MovingAxes, goal: Actuation, rates: AxisRates, time_s: float, straight: Lines
) -> MovingAxes | None:
    """The state after ``time_s`` on the straight line of the present motion, to its point nearest to a goal.

    None where the axes are not on a line.
    """
    scale = rates.velocity
    velocity = _rounded([v / unit for v, unit in zip(state.velocity, scale, strict=True)])
    acceleration = _rounded([a / unit for a, unit in zip(state.acceleration, scale, strict=True)])
    most = [a / unit for a, unit in zip(rates.acceleration, scale, strict=True)]
    shares = _shares(velocity, velocity, acceleration, most)
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
    return None if found is None else _at(found, time_s, state.position, still, rates)


def _stop(state: MovingAxes, rates: AxisRates, together: bool, straight: Lines) -> Any:
    import ruckig

    kind = ruckig.Synchronization.Time if together else ruckig.Synchronization.No
    still = (0.0,) * len(state.position)
    return _planned(still, state, still, rates, ruckig.ControlInterface.Velocity, kind, straight=straight)


def _planned(
    gaps: Sequence[float],
    state: MovingAxes,
    frame: Actuation,
    rates: AxisRates,
    interface: Any,
    kind: Any,
    *,
    straight: Lines,
) -> Any:
    """The motion of ruckig from a state to rest in a frame, None where it finds none."""
    import ruckig

    scale = rates.velocity
    position = _rounded([gap / unit for gap, unit in zip(gaps, scale, strict=True)])
    speeds = zip(state.velocity, frame, scale, strict=True)
    velocity = _rounded([(speed - v) / unit for speed, v, unit in speeds])
    acceleration = _rounded([a / b for a, b in zip(state.acceleration, scale, strict=True)])
    if straight is Lines.EXACT:  # a way that is rounded in motion is a step
        moves = zip(gaps, scale, position, velocity, acceleration, strict=True)
        position = [gap / unit if v or a else at for gap, unit, at, v, a in moves]
    top = [1.0 - v / unit for v, unit in zip(frame, scale, strict=True)]
    low = [-1.0 - v / unit for v, unit in zip(frame, scale, strict=True)]
    most = [a / b for a, b in zip(rates.acceleration, scale, strict=True)]
    jerk = [j / unit for j, unit in zip(rates.jerk, scale, strict=True)]
    shares: list[float] = []
    if straight and kind != ruckig.Synchronization.No:
        way = position if interface == ruckig.ControlInterface.Position else velocity
        if way is position and straight is Lines.EXACT and any(position):
            way = [gap / unit for gap, unit in zip(gaps, scale, strict=True)]
        shares = _shares(way, velocity, acceleration, most)
    if shares:
        (lead,) = [k for k, share in enumerate(shares) if share == 1.0][:1]
        moving = [(share, k) for k, share in enumerate(shares) if share]
        ends = [sorted((low[k] / share, top[k] / share)) for share, k in moving]
        position, velocity, acceleration = [position[lead]], [velocity[lead]], [acceleration[lead]]
        low, top = [max(each[0] for each in ends)], [min(each[1] for each in ends)]
        most = [min(most[k] / abs(share) for share, k in moving)]
        jerk = [min(jerk[k] / abs(share) for share, k in moving)]
    solver, asked, trajectory = _solver(len(position))
    asked.control_interface, asked.synchronization = interface, kind
    asked.current_position, asked.current_velocity = position, velocity
    asked.current_acceleration, asked.max_acceleration = acceleration, most
    asked.max_velocity, asked.min_velocity = top, low
    for part in _JERKS:
        asked.max_jerk = [part * each for each in jerk]
        try:
            result = solver.calculate(asked, trajectory)
        except Exception:  # no profile found
            continue
        if result in (ruckig.Result.Working, ruckig.Result.Finished):
            return _Line(trajectory, shares, gaps, scale) if shares else trajectory
    return None


class _Line:
    """The motion of several axes on a straight line, by that of one."""

    def __init__(
        self, motion: Any, shares: Sequence[float], gaps: Sequence[float], scale: Sequence[float]
    ) -> None:
        self._motion, self._shares = motion, shares
        self._start = [gap / unit for gap, unit in zip(gaps, scale, strict=True)]
        self._from: float = motion.at_time(0.0)[0][0]
        self.duration: float = motion.duration

    def at_time(self, time_s: float) -> tuple[list[float], list[float], list[float]]:
        """Position, velocity and acceleration of every axis, as ruckig gives them."""
        ((x,), (v,), (a,)) = self._motion.at_time(time_s)[:3]
        moved = x - self._from
        return (
            [at + share * moved for at, share in zip(self._start, self._shares, strict=True)],
            [share * v for share in self._shares],
            [share * a for share in self._shares],
        )


def _shares(
    way: Sequence[float], velocity: Sequence[float], acceleration: Sequence[float], most: Sequence[float]
) -> list[float]:
    """By how much each axis moves when that with the longest way moves by 1; none where rates lead aside."""
    lead = max(range(len(way)), key=lambda k: abs(way[k]))
    if not way[lead]:
        return []
    shares = [each / way[lead] for each in way]
    v, a = velocity[lead], acceleration[lead]
    rates = zip(shares, velocity, acceleration, most, strict=True)
    if all(abs(x - s * v) <= _PARALLEL and abs(y - s * a) <= _PARALLEL * top for s, x, y, top in rates):
        return shares
    return []


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


def _rounded(values: Sequence[float]) -> list[float]:
    return [0.0 if abs(value) < _NONE else value for value in values]
