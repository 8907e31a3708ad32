"""Bounds of the distance between two bodies, and between a body and an obstacle, by branch and bound.

The kernel ``clearance`` computes them; the functions here whose names begin with ``numpy_`` are its twins.

A node is a range of samples of a body, bounded by its chord and an allowance (`contid.clearance.body`). Pairs
of nodes whose lower bound exceeds the best upper bound are dropped, the others are halved down to single
pieces. The result holds for the curves between the samples, not only for the samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.clearance.body import Body, Indices
from contid.clearance.obstacles import Obstacle
from contid.kernels import load
from contid.kinematics.array import Array

#: The chord of a half is not exactly on that of the whole, even on a straight body [m].
_ROUNDING_M: Final = 1e-12
_GOLDEN: Final = 0.5 * (math.sqrt(5.0) - 1.0)
#: Leaves a bracket of 5e-7 of a piece, which is subtracted from the bound.
_GOLDEN_STEPS: Final = 30


@dataclass(frozen=True, slots=True)
class Distance:
    """A distance between surfaces: ``lower_m <= truth <= upper_m``, negative for a penetration.

    Attributes:
        lower_m, upper_m: bounds [m].
        at_m: arc length from the base of the first body where it is nearest [m].
    """

    lower_m: float
    upper_m: float
    at_m: float


def between_bodies(a: Body, b: Body, enough_m: float = math.inf) -> Distance:
    """Distance between the surfaces of two bodies [m].

    Args:
        a: a body.
        b: another body.
        enough_m: stop halving as soon as the distance is certainly at least this.
    """
    kernel = load("clearance")
    if kernel is None:
        return numpy_between_bodies(a, b, enough_m)
    radii, off_m = a.radius_m + b.radius_m, a.off_m + b.off_m
    lower, upper, at, _ = kernel.between(
        a.points, a.spacing_m, b.points, b.spacing_m, enough_m + radii + off_m
    )
    return Distance(lower - radii - off_m, upper - radii + off_m, a.start_m + at * a.spacing_m)


def numpy_between_bodies(a: Body, b: Body, enough_m: float = math.inf) -> Distance:
    """Twin of `between_bodies`."""
    radii = a.radius_m + b.radius_m
    a0, a1 = np.array([0]), np.array([a.pieces])
    b0, b1 = np.array([0]), np.array([b.pieces])
    best = math.inf
    while True:
        p, q = a.points[a0], b.points[b0]
        centre = segment_distance(p, a.points[a1] - p, q, b.points[b1] - q) - radii
        slack = a.allowance(a0, a1) + b.allowance(b0, b1) + a.off_m + b.off_m
        lower = centre - slack
        # The curve passes within the allowance of every point of its chord.
        best = min(best, float(np.min(centre + slack)))
        nearest = int(np.argmin(lower))
        least = float(lower[nearest])
        leaves = (a1 - a0 == 1) & (b1 - b0 == 1)
        if least >= enough_m or leaves.all():
            at_m = a.start_m + 0.5 * float(a0[nearest] + a1[nearest]) * a.spacing_m
            return Distance(least, best, at_m)
        keep = lower <= best + _ROUNDING_M
        a0, a1, b0, b1 = a0[keep], a1[keep], b0[keep], b1[keep]
        a0, a1, b0, b1 = _halved(a0, a1, b0, b1)
        b0, b1, a0, a1 = _halved(b0, b1, a0, a1)


def to_obstacle(body: Body, obstacle: Obstacle, enough_m: float = math.inf) -> Distance:
    """Distance between the surfaces of a body and of a convex obstacle [m].

    Args:
        body: the body.
        obstacle: a convex set.
        enough_m: stop halving as soon as the distance is certainly at least this.
    """
    kernel = load("clearance")
    if kernel is None:
        return numpy_to_obstacle(body, obstacle, enough_m)
    radius_m, off_m = body.radius_m, body.off_m
    lower, upper, at, _ = kernel.to_obstacle(
        body.points, body.spacing_m, obstacle.packed, enough_m + radius_m + off_m
    )
    at_m = body.start_m + at * body.spacing_m
    return Distance(lower - radius_m - off_m, upper - radius_m + off_m, at_m)


def numpy_to_obstacle(body: Body, obstacle: Obstacle, enough_m: float = math.inf) -> Distance:
    """Twin of `to_obstacle`."""
    enough_m += body.off_m
    values = obstacle.signed_distance(body.points) - body.radius_m
    first, last = np.array([0]), np.array([body.pieces])
    best = float(np.min(values))
    while True:
        # The distance changes at most as fast as the arc length.
        lower = 0.5 * (values[first] + values[last] - (last - first) * body.spacing_m)
        least = float(lower.min())
        if least >= enough_m or int((last - first).max()) == 1:
            break
        keep = lower <= best + _ROUNDING_M
        first, last, _, _ = _halved(first[keep], last[keep], first[keep], last[keep])
    if least < enough_m:
        keep = lower <= best + _ROUNDING_M
        first, last = first[keep], last[keep]
        chord_min, rounding = _least_on_chords(body.points[first], body.points[last], obstacle)
        slack = body.allowance(first, last)
        lower = np.maximum(lower[keep], chord_min - body.radius_m - slack - rounding)
        best = min(best, float(np.min(chord_min - body.radius_m + slack)))
        least = float(lower.min())
    nearest = int(lower.argmin())
    at_m = body.start_m + 0.5 * float(first[nearest] + last[nearest]) * body.spacing_m
    return Distance(least - body.off_m, best + body.off_m, at_m)


def _halved(
    first: Indices, last: Indices, other0: Indices, other1: Indices
) -> tuple[Indices, Indices, Indices, Indices]:
    """Nodes of more than one piece in two halves, beside copies of the other members of their pairs."""
    more = last - first > 1
    middle = (first + last) // 2
    return (
        np.concatenate([first, middle[more]]),
        np.concatenate([np.where(more, middle, last), last[more]]),
        np.concatenate([other0, other0[more]]),
        np.concatenate([other1, other1[more]]),
    )


def segment_distance(p: Array, u: Array, q: Array, v: Array) -> Array:
    """Distance between segments ``p + s u`` and ``q + t v``, s and t in 0 to 1; arrays ``(n, 3)``.

    The least of the crossing of the lines, where it is inside both, and of the four ends. Nearly parallel
    segments have no well-defined crossing; there the ends decide.
    """
    r = p - q
    uu, vv, uv = _dot(u, u), _dot(v, v), _dot(u, v)
    ur, vr = _dot(u, r), _dot(v, r)
    tiny = np.finfo(float).tiny
    determinant = uu * vv - uv * uv
    s = np.clip((uv * vr - vv * ur) / np.maximum(determinant, tiny), 0.0, 1.0)
    t = np.clip((uv * s + vr) / np.maximum(vv, tiny), 0.0, 1.0)
    s = np.clip((uv * t - ur) / np.maximum(uu, tiny), 0.0, 1.0)
    squared = _squared(r, s, u, t, v)
    for end in (0.0, 1.0):
        s_end = np.clip((uv * end - ur) / np.maximum(uu, tiny), 0.0, 1.0)
        t_end = np.clip((uv * end + vr) / np.maximum(vv, tiny), 0.0, 1.0)
        fixed = np.full_like(s, end)
        squared = np.minimum(squared, _squared(r, s_end, u, fixed, v))
        squared = np.minimum(squared, _squared(r, fixed, u, t_end, v))
    return np.asarray(np.sqrt(squared))


def _squared(r: Array, s: Array, u: Array, t: Array, v: Array) -> Array:
    apart = r + s[:, None] * u - t[:, None] * v
    return _dot(apart, apart)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", a, b))


def _least_on_chords(start: Array, end: Array, obstacle: Obstacle) -> tuple[Array, Array]:
    """Least signed distance on every chord (convex along it) by golden section, and the error of it."""
    chord = end - start
    low, high = np.zeros(len(chord)), np.ones(len(chord))

    def value(t: Array) -> Array:
        return obstacle.signed_distance(start + t[:, None] * chord)

    found = np.minimum(value(low), value(high))
    for _ in range(_GOLDEN_STEPS):
        width = _GOLDEN * (high - low)
        left, right = high - width, low + width
        at_left, at_right = value(left), value(right)
        found = np.minimum(found, np.minimum(at_left, at_right))
        lower_left = at_left <= at_right
        low, high = np.where(lower_left, low, left), np.where(lower_left, right, high)
    return found, (high - low) * np.linalg.norm(chord, axis=1)
