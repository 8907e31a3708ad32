"""The point of planar curves nearest to a goal: every valley of the distance, as long as it can still win.

A finger at the rim of its reach moves its tip by a third of its length between two samples of the boundary:
the nearest sample need not lie in the valley of the nearest point. So every sample nearer than its
neighbours is looked into, unless the way of the tip there is too short to come nearer than what was found.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

from contid.targets import Vec3

#: Where a tip is at a parameter.
Curve = Callable[[float], Vec3]

_INVERSE_GOLDEN: Final = (math.sqrt(5.0) - 1.0) / 2.0
# Golden section shrinks by 0.618 a step; the distance is flat at its least, so half the bits are enough.
_GOLDEN_STEPS: Final = 40
# Way of the tip between two samples by its chord; 1.2 is that of an arc of two radians.
_DETOUR: Final = 1.2


class _Valley(NamedTuple):
    """A sample nearer than its neighbours: its distance, which curve, the parameters, and what can be won."""

    distance: float
    curve: int
    at: float
    low: float
    high: float
    floor: float


def nearest_on(curves: Sequence[Curve], pieces: Sequence[Sequence[float]], goal: Vec3) -> tuple[int, float]:
    """Number of the curve and parameter of the point nearest to ``goal``.

    Args:
        curves: x and y over a common parameter; ties go to the first.
        pieces: samples of the parameter, in pieces without a corner of any curve.
        goal: in the frame and unit of the curves. One that is no number is equally far from everything: the
            first sample stands for all.
    """
    valleys = sorted(
        valley
        for number, curve in enumerate(curves)
        for piece in pieces
        for valley in _valleys(number, curve, piece, goal)
    )
    if not valleys:
        return 0, pieces[0][0]
    best = valleys[0].distance, valleys[0].curve, valleys[0].at
    for valley in valleys:
        if valley.floor < best[0]:
            curve = curves[valley.curve]
            u = _golden_section(curve, goal, valley)
            best = min(best, (_distance(curve(u), goal), valley.curve, u))
    return best[1:]


def _valleys(number: int, curve: Curve, samples: Sequence[float], goal: Vec3) -> Iterator[_Valley]:
    points = [curve(u) for u in samples]
    away = [_distance(point, goal) for point in points]
    last = len(samples) - 1
    # Between two samples no point is nearer than this.
    floors = [
        0.5 * (away[i] + away[i + 1] - _DETOUR * _distance(points[i], points[i + 1])) for i in range(last)
    ]
    for i, distance in enumerate(away):
        before, after = max(i - 1, 0), min(i + 1, last)
        # A plateau counts once.
        if (i == 0 or distance < away[before]) and distance <= away[after]:
            floor = min(floors[before:after])
            yield _Valley(distance, number, samples[i], samples[before], samples[after], floor)


def _distance(a: Vec3, b: Vec3) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])


def _golden_section(curve: Curve, goal: Vec3, valley: _Valley) -> float:
    """Parameter of the point of a curve nearest to ``goal`` within a valley."""
    low, high = valley.low, valley.high
    a, b = high - _INVERSE_GOLDEN * (high - low), low + _INVERSE_GOLDEN * (high - low)
    at_a, at_b = _distance(curve(a), goal), _distance(curve(b), goal)
    for _ in range(_GOLDEN_STEPS):
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - _INVERSE_GOLDEN * (high - low)
            at_a = _distance(curve(a), goal)
        else:
            low, a, at_a = a, b, at_b
            b = low + _INVERSE_GOLDEN * (high - low)
            at_b = _distance(curve(b), goal)
    return 0.5 * (low + high)
