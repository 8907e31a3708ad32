"""Jerk-limited motions to a rest of axes whose limits differ, every axis at rest at the same instant.

On straight lines, which ruckig leaves for such axes.

An axis goes from its velocity u to a cruise velocity c, cruises, and stops:

    u -> c -> 0,    d = (u + c) / 2 ramp(c - u) + c hold + c / 2 ramp(c)
    ramp(x) = 2 sqrt(|x| / j) below a^2 / j, else |x| / a + a / j

From standstill, and where it must turn back, d is monotone in c: the fastest motion has the largest c, and
each longer duration exactly one. An axis that moves towards its goal has motions with c beyond u, and slower
ones that stop first; durations between the two are none of its own, and all axes take a longer one.

From standstill the duration is the shortest possible, that of ruckig. From motion it is longer than
necessary: the acceleration is 0 at the cruise velocity, also where it need not be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from contid.trajectory.standstill import Knot, extend, state_at

#: Of a bisection: beyond the digits of a float64.
_STEPS = 200


class CruiseMotion:
    """All axes; one that rests at its goal stays there."""

    def __init__(self, axes: Sequence[CruiseAxis]) -> None:
        duration_s, before_s = 0.0, -1.0
        while duration_s != before_s:  # ends: beyond the longest stop every axis has a motion
            before_s = duration_s
            for axis in axes:
                duration_s = axis.next_duration_s(duration_s)
        self.duration = duration_s
        self._knots = [axis.knots(duration_s) for axis in axes]

    def at_time(self, time_s: float) -> tuple[list[float], list[float]]:
        """Positions and velocities."""
        states = [state_at(knots, time_s) for knots in self._knots]
        return [each.position for each in states], [each.velocity for each in states]

    def acceleration_at(self, time_s: float) -> list[float]:
        """Accelerations."""
        return [state_at(knots, time_s).acceleration for knots in self._knots]


class StraightMotion:
    """All axes from standstill along a straight line."""

    def __init__(
        self, start: Sequence[float], goal: Sequence[float], limits: Sequence[Sequence[float]]
    ) -> None:
        self._start, self._way = start, [b - a for a, b in zip(start, goal, strict=True)]
        moving = [k for k, way in enumerate(self._way) if way != 0.0]
        shared = [min((limit[k] / abs(self._way[k]) for k in moving), default=1.0) for limit in limits]
        self._motion = CruiseMotion([CruiseAxis(0.0, 0.0, 1.0 if moving else 0.0, *shared)])
        self.duration = self._motion.duration

    def at_time(self, time_s: float) -> tuple[list[float], list[float]]:
        """Positions and velocities."""
        (share,), (speed,) = self._motion.at_time(time_s)
        return (
            [a + share * way for a, way in zip(self._start, self._way, strict=True)],
            [speed * way for way in self._way],
        )

    def acceleration_at(self, time_s: float) -> list[float]:
        """Accelerations."""
        (share,) = self._motion.acceleration_at(time_s)
        return [share * way for way in self._way]


class CruiseAxis:
    """The motions of one axis."""

    def __init__(
        self, start: float, velocity: float, goal: float, fastest: float, acceleration: float, jerk: float
    ) -> None:
        self._start, self._goal, self._velocity = start, goal, velocity
        self._acceleration, self._jerk = acceleration, jerk
        self._stop_s = self._ramp_s(velocity)
        left = goal - start - 0.5 * velocity * self._stop_s
        self._sign = math.copysign(1.0, left)
        self._fastest = max(fastest, velocity * self._sign)
        # Stopping first: the rest of the way from standstill.
        self._left = abs(left)
        self._from_rest = self._quickest(0.0, self._left, 0.0)
        self._after_stop_s = self._stop_s + self._duration_s(0.0, self._left, self._from_rest)
        # Without stopping: cruise velocities from that of a turn, or of the axis itself, on.
        self._slowest = max(velocity * self._sign, 0.0)
        self._way = (goal - start) * self._sign
        self._own = velocity * self._sign
        self._cruise = self._quickest(self._own, self._way, self._slowest)
        self._shortest_s = self._duration_s(self._own, self._way, self._cruise)

    def next_duration_s(self, least_s: float) -> float:
        """The shortest duration that is not less than ``least_s``."""
        if self._left == 0.0:
            return max(least_s, self._stop_s)
        shortest_s, longest_s = self._without_stop()
        if least_s <= longest_s:
            return max(least_s, shortest_s)
        return max(least_s, self._after_stop_s)

    def knots(self, duration_s: float) -> list[Knot]:
        """The pieces of the motion of a duration from `next_duration_s`."""
        knots: list[Knot] = [Knot(0.0, self._start, self._velocity, 0.0, 0.0)]
        shortest_s, longest_s = self._without_stop()
        own, way, slowest, most = self._own, self._way, self._slowest, self._cruise
        if self._left == 0.0 or not shortest_s <= duration_s <= longest_s:
            self._add_ramp(knots, -self._velocity)
            duration_s -= self._stop_s
            own, way, slowest, most = 0.0, self._left, 0.0, self._from_rest
        if self._left > 0.0:
            cruise = self._cruise_of(duration_s, own, way, slowest, most)
            self._add_ramp(knots, self._sign * (cruise - own))
            extend(knots, max(self._hold_s(own, way, cruise), 0.0), 0.0)
            self._add_ramp(knots, -self._sign * cruise)
        knots.append(Knot(knots[-1].time_s, self._goal, 0.0, 0.0, 0.0))
        return knots

    def _without_stop(self) -> tuple[float, float]:
        """Shortest and longest duration of the motions that do not stop first."""
        if self._slowest == 0.0:
            return self._shortest_s, math.inf
        return self._shortest_s, self._duration_s(self._own, self._way, self._slowest)

    def _ramp_s(self, change: float) -> float:
        """Duration of a change of velocity, without acceleration at its ends."""
        change = abs(change)
        if change * self._jerk <= self._acceleration**2:
            return 2.0 * math.sqrt(change / self._jerk)
        return change / self._acceleration + self._acceleration / self._jerk

    def _hold_s(self, own: float, way: float, cruise: float) -> float:
        """How long an axis cruises; negative where the way is too short for the velocity."""
        ramps = 0.5 * ((own + cruise) * self._ramp_s(cruise - own) + cruise * self._ramp_s(cruise))
        return (way - ramps) / cruise if cruise > 0.0 else math.inf

    def _duration_s(self, own: float, way: float, cruise: float) -> float:
        hold_s = max(self._hold_s(own, way, cruise), 0.0)
        return self._ramp_s(cruise - own) + hold_s + self._ramp_s(cruise)

    def _quickest(self, own: float, way: float, slowest: float) -> float:
        """The largest cruise velocity for which the way is long enough."""
        if self._hold_s(own, way, self._fastest) >= 0.0:
            return self._fastest
        return _last(lambda cruise: self._hold_s(own, way, cruise) >= 0.0, slowest, self._fastest)

    def _cruise_of(self, duration_s: float, own: float, way: float, slowest: float, most: float) -> float:
        """The cruise velocity of a duration, which falls with it."""
        if self._duration_s(own, way, most) >= duration_s:
            return most
        return _last(lambda cruise: self._duration_s(own, way, cruise) >= duration_s, slowest, most)

    def _add_ramp(self, knots: list[Knot], change: float) -> None:
        size = abs(change)
        jerk = math.copysign(self._jerk, change)
        up_s = min(math.sqrt(size / self._jerk), self._acceleration / self._jerk)
        for lasts_s, slope in ((up_s, jerk), (self._ramp_s(change) - 2.0 * up_s, 0.0), (up_s, -jerk)):
            extend(knots, lasts_s, slope)
        knots[-1] = knots[-1]._replace(acceleration=0.0)  # without the rounding of the acceleration


def _last(holds: Callable[[float], bool], low: float, high: float) -> float:
    """The largest value for which a condition holds that holds from ``low`` on and not at ``high``."""
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if holds(middle):
            low = middle
        else:
            high = middle
    return low
