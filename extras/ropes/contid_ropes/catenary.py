"""A rope that hangs between two points: the catenary of given length.

With the height difference Z, the horizontal span X and the length l:

    ``sinh(xi) / xi = sqrt(l^2 - Z^2) / X``,  ``a = X / (2 xi)``,  ``x0 = X / 2 - a atanh(Z / l)``,
    ``z = a cosh((x - x0) / a) + const``

where x runs horizontally from the start towards the end and x0 is the lowest point of the whole curve
(between the ends only when both pull upwards). Gravity is along -z of the frame of the points. Singh et al.
(IROS 2018) measure the end directions of the rope; the catenary gives those of a pinned one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.targets import Vec3
from contid_ropes.ph.ends import CurveEnds, PhFit, through

#: Minimum span, as a share of the length; a rope with closer ends hangs folded.
FOLDED: Final = 1e-9
#: Below this xi the sag is below rounding: the rope is a straight line.
TAUT: Final = 1e-7


@dataclass(frozen=True, slots=True)
class Catenary:
    """A hanging rope.

    Attributes:
        start_m, end_m: ends [m].
        length_m: length of the rope [m].
        a_m: the catenary's parameter, horizontal tension by weight per length [m]; inf for a taut rope.
        slope_start: dz/dx at the start, ``sinh(-x0 / a)``.
        heading: horizontal unit vector from start to end.
    """

    start_m: Vec3
    end_m: Vec3
    length_m: float
    a_m: float
    slope_start: float
    heading: tuple[float, float]

    @property
    def taut(self) -> bool:
        """True for the straight line, whose tension is undetermined."""
        return math.isinf(self.a_m)

    @property
    def start_direction(self) -> Vec3:
        """Unit tangent at the start, along the direction of travel."""
        return self.direction_at(0.0)

    @property
    def end_direction(self) -> Vec3:
        """Unit tangent at the end, along the direction of travel."""
        return self.direction_at(self.length_m)

    @property
    def lowest(self) -> Vec3:
        """The lowest point of the rope [m]: the vertex when it hangs between the ends, else the lower end."""
        at_m = -self.a_m * self.slope_start
        if not self.taut and 0.0 < at_m < self.length_m:
            return self.at(at_m)
        return min(self.start_m, self.end_m, key=lambda point: point[2])

    def at(self, s_m: float) -> Vec3:
        """The point at the length ``s_m`` from the start [m]."""
        x0, y0, z0 = self.start_m
        if self.taut:
            share = s_m / self.length_m
            x1, y1, z1 = self.end_m
            return (x0 + share * (x1 - x0), y0 + share * (y1 - y0), z0 + share * (z1 - z0))
        slope = self._slope(s_m)
        x = self.a_m * (math.asinh(slope) - math.asinh(self.slope_start))
        # cosh(b) - cosh(a) by the sinh of both, without the cancellation of two large numbers.
        rise = s_m * (slope + self.slope_start) / (math.hypot(1.0, slope) + math.hypot(1.0, self.slope_start))
        return (x0 + self.heading[0] * x, y0 + self.heading[1] * x, z0 + rise)

    def direction_at(self, s_m: float) -> Vec3:
        """Unit tangent at the length ``s_m`` from the start."""
        slope = self._slope(s_m)
        size = math.hypot(1.0, slope)
        return (self.heading[0] / size, self.heading[1] / size, slope / size)

    def points(self, count: int) -> Array:
        """Points at equal arc length from start to end [m], shape ``(count, 3)``."""
        return np.array([self.at(s) for s in np.linspace(0.0, self.length_m, count).tolist()])

    def pull_n(self, weight_n: float) -> tuple[float, float]:
        """Tension at the start and at the end [N] of a rope of this weight; inf when it is taut."""
        horizontal_n = weight_n * self.a_m / self.length_m
        ends = (self.slope_start, self._slope(self.length_m))
        return horizontal_n * math.hypot(1.0, ends[0]), horizontal_n * math.hypot(1.0, ends[1])

    def _slope(self, s_m: float) -> float:
        return self.slope_start + s_m / self.a_m


def hang(start_m: Vec3, end_m: Vec3, length_m: float) -> Catenary | None:
    """The rope between two points [m], or None when it is shorter than their distance."""
    dx, dy, dz = (b - a for a, b in zip(start_m, end_m, strict=True))
    chord = math.hypot(dx, dy, dz)
    if not (length_m > 0.0 and length_m >= chord):
        return None
    flat = math.hypot(dx, dy)
    heading = (dx / flat, dy / flat) if flat > 0.0 else (1.0, 0.0)
    span = max(flat, FOLDED * length_m)
    # (l - chord)(l + chord) keeps the digits of a nearly taut rope.
    surplus = max(0.0, (length_m - chord) * (length_m + chord) - (span - flat) * (span + flat))
    xi = stretch(surplus / (span * span))
    if xi < TAUT:
        return Catenary(start_m, end_m, length_m, math.inf, dz / span, heading)
    a = span / (2.0 * xi)
    return Catenary(start_m, end_m, length_m, a, -math.sinh(xi - math.atanh(dz / length_m)), heading)


def stretch(surplus: float) -> float:
    """The xi with ``(sinh(xi) / xi)^2 = 1 + surplus``: Newton inside a bracket, on logarithms.

    ``log(sinh(xi) / xi)`` is nearly a parabola below 1 and nearly a line above: Newton converges fast for
    both, and nothing overflows.
    """
    ratio = 0.5 * math.log1p(surplus)
    if ratio <= 0.0:
        return 0.0
    low, high = math.sqrt(6.0 * ratio), ratio + math.log(2.0 * ratio + 4.0) + 1.0
    high = max(high, low * 1.5)
    xi = low
    for _ in range(60):
        excess = _log_sinhc(xi) - ratio
        low, high = (xi, high) if excess < 0.0 else (low, xi)
        step = xi - excess / _log_sinhc_slope(xi)
        new = step if low < step < high else 0.5 * (low + high)
        if abs(new - xi) <= 2e-16 * xi:
            return new
        xi = new
    return xi


def as_quintic(rope: Catenary) -> PhFit:
    """The rope as one quintic with its length and end directions.

    Points at equal arc length are off by 0.01 mm per metre for a rope 10 % longer than its level span,
    0.14 at 30 %; on a slope of 17 degrees by 0.65 and 3.4, two pieces there by 0.35.
    """
    return through(
        CurveEnds(rope.start_m, rope.end_m, rope.start_direction, rope.end_direction), rope.length_m
    )


def _log_sinhc(xi: float) -> float:
    """``log(sinh(xi) / xi)``."""
    if xi < 0.05:
        q = xi * xi
        return q * (1.0 / 6.0 - q * (1.0 / 180.0 - q * (1.0 / 2835.0 - q / 37800.0)))
    return xi + math.log(-math.expm1(-2.0 * xi) / (2.0 * xi))


def _log_sinhc_slope(xi: float) -> float:
    """Derivative of `_log_sinhc`: ``coth(xi) - 1 / xi``."""
    if xi < 0.05:
        q = xi * xi
        return xi * (1.0 / 3.0 - q * (1.0 / 45.0 - q * (2.0 / 945.0 - q / 4725.0)))
    return 1.0 / math.tanh(xi) - 1.0 / xi
