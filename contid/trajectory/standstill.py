"""The jerk-limited stop: from any velocity and acceleration to rest, every axis at the same instant.

The acceleration a of an axis goes to a plateau b at full jerk j, stays there, and returns to zero:

    T = |b - a| / j + hold + |b| / j,        v + ramps(b) + b hold = 0

The slowest axis sets T. The change of speed is monotone in b, so each of the others has exactly one b, the
root of a quadratic. Acceleration beyond its limit returns to the limit first. There is no search and no
tolerance, so it cannot fail. (ruckig 0.19, used for the approach, refuses one in eleven pairs of axes that
move alike with an acceleration beyond the limit.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from contid.targets import Actuation
from contid.trajectory.approach import Limit, MotionError, per_axis
from contid.trajectory.pieces import Knot, advanced, state_at


class JerkLimitedStop:
    """A motion to a standstill; see `stopping`."""

    def __init__(self, axes: Sequence[_StoppingAxis], position: Actuation, velocity: Actuation) -> None:
        together_s = max((axis.shortest_s for axis in axes), default=0.0)
        self._start = position, velocity
        self._knots = [axis.knots(each, together_s) for axis, each in zip(axes, position, strict=True)]
        self._end = tuple([knots[-1][1] for knots in self._knots]), (0.0,) * len(axes)
        self._duration_s = max((knots[-1][0] for knots in self._knots), default=0.0)

    @property
    def duration_s(self) -> float:
        """Time until every axis rests."""
        return self._duration_s

    @property
    def goal(self) -> Actuation:
        """Position at the end."""
        return self._end[0]

    def at(self, time_s: float) -> tuple[Actuation, Actuation]:
        """Position and velocity ``time_s`` after the start; the start before it, rest at the end after."""
        if time_s >= self._duration_s:
            return self._end
        if time_s <= 0.0:
            return self._start
        states = [state_at(knots, time_s) for knots in self._knots]
        return tuple([position for position, _ in states]), tuple([velocity for _, velocity in states])


def stopping(
    position: Sequence[float],
    velocity: Sequence[float],
    acceleration: Sequence[float],
    acceleration_limit: Limit,
    jerk_limit: Limit,
) -> JerkLimitedStop:
    """The stop from any state, every axis at rest at the same instant.

    Args:
        position: [m or Pa].
        velocity: [m/s or Pa/s], also beyond any velocity limit.
        acceleration: [m/s^2 or Pa/s^2], also beyond ``acceleration_limit``.
        acceleration_limit: one for all axes, or one per axis.
        jerk_limit: the same.

    Raises:
        MotionError: numbers that are not finite, or limits that are not positive.
    """
    axes = len(position)
    limit, jerk = per_axis(acceleration_limit, axes), per_axis(jerk_limit, axes)
    if any(not value > 0.0 for value in (*limit, *jerk)):
        raise MotionError(f"acceleration and jerk limits must be positive, got {limit} and {jerk}")
    if not all(map(math.isfinite, (*position, *velocity, *acceleration))):
        raise MotionError(
            f"no stop from position {list(position)}, velocity {list(velocity)}, "
            f"acceleration {list(acceleration)}: they must be finite"
        )
    stops = [_StoppingAxis(*each) for each in zip(velocity, acceleration, limit, jerk, strict=True)]
    return JerkLimitedStop(stops, tuple(map(float, position)), tuple(map(float, velocity)))


class _StoppingAxis:
    """The stops of one axis, mirrored so that its acceleration is not negative.

    Args:
        velocity: at the beginning [m/s or Pa/s].
        acceleration: at the beginning; may exceed the limit.
        limit: of the acceleration.
        jerk: limit of the jerk.

    Attributes:
        shortest_s: minimum time to rest.
    """

    def __init__(self, velocity: float, acceleration: float, limit: float, jerk: float) -> None:
        self._velocity, self._acceleration, self._jerk = velocity, acceleration, jerk
        self._sign = math.copysign(1.0, acceleration)
        #: Acceleration once it is back within its limit, and the time until then.
        self._begin = min(abs(acceleration), limit)
        self._back_s = (abs(acceleration) - self._begin) / jerk
        change = -self._sign * velocity - 0.5 * (abs(acceleration) + self._begin) * self._back_s
        #: Change of speed by the plateau, in addition to that while the acceleration returns to zero.
        self._added = change - 0.5 * self._begin**2 / jerk
        self._out_s = self._begin / jerk
        # The plateau of the shortest stop; without a hold when below its limit.
        if self._added >= 0.0:
            self._peak = min(limit, math.sqrt(self._begin**2 + jerk * self._added))
        else:
            self._peak = -min(limit, math.sqrt(-jerk * self._added))
        self.shortest_s = self._back_s + sum(self._parts(self._peak))

    def knots(self, position: float, together_s: float) -> list[Knot]:
        """The parts of a stop of this duration, the last one at rest."""
        plateau = self._plateau(together_s - self._back_s)
        up_s, hold_s, down_s = self._parts(plateau)
        parts = (
            (self._back_s, -self._jerk),
            (up_s, math.copysign(self._jerk, plateau - self._begin)),
            (hold_s, 0.0),
            (down_s, -math.copysign(self._jerk, plateau)),
        )
        out = [(0.0, position, self._velocity, self._acceleration, 0.0)]
        for lasts_s, slope in parts:
            begin = (*out[-1][:4], self._sign * slope)
            out[-1] = begin
            out.append((begin[0] + lasts_s, *advanced(begin, lasts_s), 0.0))
        return out

    def _plateau(self, lasts_s: float) -> float:
        """The plateau of a stop of this duration, from an acceleration within its limit."""
        left_s = lasts_s - self._out_s
        if self._added >= self._begin * left_s:
            # b^2 - j (T + a/j) b + a^2 + j added = 0
            half = 0.5 * self._jerk * (lasts_s + self._out_s)
            value = _small_root(half, self._begin**2 + self._jerk * self._added)
        elif self._added >= 0.0:
            value = self._added / left_s
        else:
            value = -_small_root(0.5 * self._jerk * left_s, -self._jerk * self._added)
        # Rounding must not exceed the peak, where the hold would be negative.
        return math.copysign(min(abs(value), abs(self._peak)), value)

    def _parts(self, plateau: float) -> tuple[float, float, float]:
        """Durations of the ramp to a plateau, the plateau, and the ramp to zero [s]."""
        if plateau == 0.0:
            return self._out_s, 0.0, 0.0
        ramps = 0.0
        if plateau > self._begin:
            ramps = (plateau**2 - self._begin**2) / self._jerk
        elif plateau < 0.0:
            ramps = -(plateau**2) / self._jerk
        hold_s = max(0.0, (self._added - ramps) / plateau)
        return abs(plateau - self._begin) / self._jerk, hold_s, abs(plateau) / self._jerk


def _small_root(half: float, product: float) -> float:
    """The smaller root of ``x^2 - 2 half x + product``, the double root when rounding leaves none."""
    double = math.sqrt(max(0.0, product))
    if half <= double:
        return double
    return product / (half + math.sqrt((half - double) * (half + double)))
