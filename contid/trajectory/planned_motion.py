"""One motion of ruckig from a state to rest in a frame that moves, of all axes or on a straight line.

Inside, every axis has its velocity limit as unit: positions are in seconds, velocities are shares of it.

Axes whose present rates already lead to the goal, or that stop from such, stay on the straight line to it:
the motion of one axis, with the limits that bind first, is theirs by shares. Ruckig itself finds that only
where the rates are parallel to the last bit.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from functools import cache
from typing import Any, Final, NamedTuple

from contid.targets import Actuation

#: Shares of the jerk limit, tried in turn: ruckig 0.19 finds no profile exactly at the border of two kinds.
_JERKS: Final = (1.0 - 1e-6, 1.0 - 1e-4, 1.0 - 1e-2)
#: Positions, velocities and accelerations below this are rounding, in velocity limits times s, 1 and 1/s.
_NONE: Final = 1e-9
#: Rates are parallel to a way within this share of their limits.
_PARALLEL: Final = 1e-9


class Lines(enum.IntEnum):
    """Straight lines of axes whose present rates allow them, by versions of the rules of motions.

    ROUNDED leads past the goal of an axis whose distance to it is rounded to zero, by at most what its
    greatest velocity makes in `_NONE` seconds. To a goal on a limit that axes share such a line led 3e-12 m
    beyond the limit. EXACT leads to the goal, and rounds no distance of an axis in motion to zero, which was
    a step of up to 2e-4 Pa.
    """

    NONE = 0
    ROUNDED = 1
    EXACT = 2

    @classmethod
    def of(cls, motion_rules: int) -> Lines:
        """Those of `contid.control.tick.config.MOTION_RULES`, or of the recording that is replayed."""
        return cls(max(0, min(motion_rules - 1, cls.EXACT)))


class MovingAxes(NamedTuple):
    """Position [m or Pa], velocity [m/s or Pa/s] and acceleration [m/s^2 or Pa/s^2] of every axis."""

    position: Actuation
    velocity: Actuation
    acceleration: Actuation


class AxisRates(NamedTuple):
    """Greatest velocity, acceleration and jerk of every axis [m or Pa, per s, s^2 and s^3]."""

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


def planned(
    gaps: Sequence[float],
    state: MovingAxes,
    frame: Actuation,
    rates: AxisRates,
    interface: Any,
    kind: Any,
    *,
    straight: Lines,
) -> Any:
    """The motion of ruckig from a state to rest in a frame, None where it finds none.

    Args:
        gaps: from the origin of the frame, where an axis comes to rest, to the axis now [m or Pa]; zeros for
            a stop, whose positions count from where it begins.
        state: now.
        frame: velocity of the frame [m/s or Pa/s].
        rates: limits of the axes.
        interface: whether ruckig controls the position or, for a stop, the velocity.
        kind: how ruckig makes the axes arrive together.
        straight: the straight line where the present rates allow it, unless each axis arrives by itself.
    """
    import ruckig

    scale = rates.velocity
    position = rounded([gap / unit for gap, unit in zip(gaps, scale, strict=True)])
    speeds = zip(state.velocity, frame, scale, strict=True)
    velocity = rounded([(speed - v) / unit for speed, v, unit in speeds])
    acceleration = rounded([a / b for a, b in zip(state.acceleration, scale, strict=True)])
    if straight is Lines.EXACT:  # a distance that is rounded in motion is a step
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
        shares = shares_of_line(way, velocity, acceleration, most)
    if shares:
        lead = shares.index(1.0)
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
            return _LineMotion(trajectory, shares, gaps, scale) if shares else trajectory
    return None


class _LineMotion:
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


def shares_of_line(
    way: Sequence[float], velocity: Sequence[float], acceleration: Sequence[float], most: Sequence[float]
) -> list[float]:
    """By how much each axis moves when that with the longest way moves by 1; none where rates lead aside.

    Args:
        way: where each axis has to go, or the velocity that it has to lose.
        velocity: of each axis.
        acceleration: of each axis.
        most: greatest acceleration of each axis.
    """
    lead = max(range(len(way)), key=lambda k: abs(way[k]))
    if not way[lead]:
        return []
    shares = [each / way[lead] for each in way]
    v, a = velocity[lead], acceleration[lead]
    rates = zip(shares, velocity, acceleration, most, strict=True)
    if all(abs(x - s * v) <= _PARALLEL and abs(y - s * a) <= _PARALLEL * top for s, x, y, top in rates):
        return shares
    return []


def state_at(
    motion: Any, time_s: float, origin: Actuation, frame: Actuation, rates: AxisRates
) -> MovingAxes | None:
    """The state of a motion of `planned` at a time; None for one that is not finite.

    Args:
        motion: in the frame, in velocity limits.
        time_s: since the state from which it was planned.
        origin: origin of the frame at that time [m or Pa].
        frame: velocity of the frame [m/s or Pa/s].
        rates: limits of the axes.
    """
    position, velocity, acceleration = motion.at_time(time_s)[:3]
    if not all(map(math.isfinite, (*position, *velocity, *acceleration))):
        return None
    scale = rates.velocity
    return MovingAxes(
        tuple([there + e * unit for there, e, unit in zip(origin, position, scale, strict=True)]),
        tuple([v + e * unit for v, e, unit in zip(frame, velocity, scale, strict=True)]),
        tuple([a * unit for a, unit in zip(acceleration, scale, strict=True)]),
    )


def rounded(values: Sequence[float]) -> list[float]:
    """Values in velocity limits, 0 where they are rounding."""
    return [0.0 if abs(value) < _NONE else value for value in values]
