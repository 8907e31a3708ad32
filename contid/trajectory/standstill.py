"""The jerk-limited stop: from any velocity and acceleration to rest, all axes at the same instant.

Counted against the velocity that is left once the acceleration is gone, ``v + a |a| / 2 j``, the acceleration
of an axis goes from its present value a to a plateau b at full jerk j, stays there, and returns to 0:

    T = (2 b - a) / j + hold,        |v| + a^2 / 2 j = b^2 / j + b hold

The slowest axis sets T; for it b is as high as the limit of acceleration allows. Each of the others has
exactly one b, the smaller root of ``b^2 - (j T + a) b + j |v| + a^2 / 2``, or where that is below a, and the
acceleration falls to the plateau, ``b = (|v| - a^2 / 2 j) / (T - a / j)``. There is no search and no
tolerance, so it cannot fail. (ruckig 0.19, used for the approach, refuses one in eleven pairs of axes that
move alike.)

Motions of one axis are pieces of constant jerk, which start at their `Knot`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from contid.kernels import load
from contid.targets import Actuation
from contid.trajectory.pursuit import AxisRates, MovingAxes


class MotionState(NamedTuple):
    """Where the axes of a robot are in a motion, and how fast [m or Pa, m/s or Pa/s]."""

    position: Actuation
    velocity: Actuation


class JerkLimitedStop:
    """A motion to a standstill.

    Args:
        position: [m or Pa].
        velocity: [m/s or Pa/s], also beyond any velocity limit.
        acceleration_limit: of every axis.
        jerk_limit: of every axis.
        acceleration: at the beginning, none by default; one beyond its limit counts as at the limit.

    Attributes:
        duration_s: time until every axis rests.
    """

    def __init__(
        self,
        position: Actuation,
        velocity: Actuation,
        acceleration_limit: Sequence[float],
        jerk_limit: Sequence[float],
        acceleration: Sequence[float] = (),
    ) -> None:
        begin = acceleration or (0.0,) * len(velocity)
        each_axis = zip(velocity, begin, acceleration_limit, jerk_limit, strict=True)
        axes = [_StoppingAxis(*each) for each in each_axis]
        together_s = max((axis.shortest_s for axis in axes), default=0.0)
        self._start = MotionState(position, velocity)
        self._knots = [axis.knots(each, together_s) for axis, each in zip(axes, position, strict=True)]
        self._end = MotionState(tuple([knots[-1].position for knots in self._knots]), (0.0,) * len(axes))
        self.duration_s = max((knots[-1].time_s for knots in self._knots), default=0.0)

    def at(self, time_s: float) -> MotionState:
        """The state ``time_s`` after the start; the start before it, rest at the end after."""
        if time_s >= self.duration_s:
            return self._end
        if time_s <= 0.0:
            return self._start
        states = [state_at(knots, time_s) for knots in self._knots]
        return MotionState(
            tuple([each.position for each in states]), tuple([each.velocity for each in states])
        )


class JointStop:
    """The stop with which the guard of a live stream compares what it commands; all axes rest at one instant.

    A robot that follows live targets can always make it inside the limits that its axes share. Axes on a
    straight line, such as that of an approach, stay on the line, which `JerkLimitedStop` leaves; the line is
    inside limits that are convex. It is compiled: ``contid/kernels/limiter/joint_stop.hpp``.

    Args:
        begin: position and rates of every axis.
        rates: limits of the axes.
        straight: on the line of rates that are parallel.

    Attributes:
        duration_s: time until every axis rests.
    """

    def __init__(self, begin: MovingAxes, rates: AxisRates, *, straight: bool = True) -> None:
        self._begin = begin
        self._motion: Any = load("limiter").JointStopMotion(begin, *rates, straight)
        self.duration_s: float = self._motion.duration_s

    def at(self, time_s: float) -> MotionState:
        """The state ``time_s`` after the start; the start before it, rest at the end after."""
        if time_s <= 0.0:
            return MotionState(self._begin.position, self._begin.velocity)
        position, velocity = self._motion.at_time(min(time_s, self.duration_s))
        return MotionState(position, velocity if time_s < self.duration_s else (0.0,) * len(velocity))


class _StoppingAxis:
    """The stops of one axis.

    Args:
        velocity: at the beginning [m/s or Pa/s].
        acceleration: at the beginning.
        limit: of the acceleration.
        jerk: limit of the jerk.

    Attributes:
        shortest_s: minimum time to rest.
    """

    def __init__(self, velocity: float, acceleration: float, limit: float, jerk: float) -> None:
        self._velocity, self._jerk = velocity, jerk
        acceleration = min(max(acceleration, -limit), limit)
        left = velocity + 0.5 * acceleration * abs(acceleration) / jerk
        self._braking = -math.copysign(1.0, left if left else velocity)
        self._begin = self._braking * acceleration
        #: Velocity to shed, from no acceleration that is on the way to the present one.
        self._speed = max(0.0, -self._braking * velocity + 0.5 * self._begin**2 / jerk)
        self._peak = min(limit, math.sqrt(jerk * self._speed))
        self.shortest_s = sum(self._parts(self._peak))

    def knots(self, position: float, together_s: float) -> list[Knot]:
        """The parts of a stop of this duration, the last one at rest."""
        j, begin = self._jerk, self._begin
        plateau = _small_root(0.5 * (j * together_s + begin), j * self._speed)
        if plateau < begin:  # the acceleration falls to the plateau
            rest_s = together_s - begin / j
            plateau = max(0.0, self._speed - begin**2 / j) / rest_s if rest_s > 0.0 else 0.0
        # Rounding must not exceed the peak, where the hold would be negative.
        plateau = min(plateau, self._peak)
        rise_s, hold_s, fall_s = self._parts(plateau)
        jerk = math.copysign(j, self._braking)
        knots: list[Knot] = [Knot(0.0, position, self._velocity, self._braking * begin, 0.0)]
        slopes = (jerk if plateau >= begin else -jerk, 0.0, -jerk)
        for lasts_s, slope in zip((rise_s, hold_s, fall_s), slopes, strict=True):
            extend(knots, lasts_s, slope)
        return knots

    def _parts(self, plateau: float) -> tuple[float, float, float]:
        """Durations of the ramp to a plateau, of the plateau, and of the ramp to no acceleration [s]."""
        j, begin = self._jerk, self._begin
        ramp_s, fall_s = abs(plateau - begin) / j, plateau / j
        if plateau == 0.0:
            return ramp_s, 0.0, 0.0
        # The ramps shed b^2 / j where the acceleration rises to b, and the present a^2 / j where it falls.
        shed = max(plateau, begin) ** 2 / j
        return ramp_s, max(0.0, (self._speed - shed) / plateau), fall_s


def _small_root(half: float, product: float) -> float:
    """The smaller root of ``x^2 - 2 half x + product``, the double root when rounding leaves none."""
    double = math.sqrt(product)
    if half <= double:
        return double
    return product / (half + math.sqrt((half - double) * (half + double)))


class AxisState(NamedTuple):
    """Position, velocity and acceleration of one axis."""

    position: float
    velocity: float
    acceleration: float


class Knot(NamedTuple):
    """Start of a piece: its time, the state of the axis there, and the jerk of the piece."""

    time_s: float
    position: float
    velocity: float
    acceleration: float
    jerk: float

    def state_after(self, by_s: float) -> AxisState:
        """The state ``by_s`` into the piece."""
        _, position, velocity, acceleration, jerk = self
        return AxisState(
            position + by_s * (velocity + by_s * (acceleration / 2.0 + by_s * jerk / 6.0)),
            velocity + by_s * (acceleration + by_s * jerk / 2.0),
            acceleration + by_s * jerk,
        )


def extend(knots: list[Knot], lasts_s: float, jerk: float) -> None:
    """Add a piece with a duration and a jerk; the last knot is its end."""
    begin = knots[-1] = knots[-1]._replace(jerk=jerk)
    knots.append(Knot(begin.time_s + lasts_s, *begin.state_after(lasts_s), 0.0))


def state_at(knots: Sequence[Knot], time_s: float) -> AxisState:
    """The state at a time; the last knot is at rest."""
    for knot in reversed(knots):
        if time_s >= knot.time_s:
            break
    if knot is knots[-1]:
        return AxisState(knot.position, 0.0, 0.0)
    return knot.state_after(time_s - knot.time_s)
