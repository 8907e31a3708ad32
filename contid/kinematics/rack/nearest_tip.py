"""The point of planar curves nearest to a goal: branch and bound over the local minima of the distance.

Between two samples of the boundary a tip can move by a third of the finger's length, so the nearest sample
need not be next to the nearest point. Every local minimum of the samples is refined, unless its lower bound
exceeds the best distance found.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

from contid.targets import Vec3

#: Position of a tip [m] as a function of a parameter.
Curve = Callable[[float], Vec3]

_INVERSE_GOLDEN: Final = (math.sqrt(5.0) - 1.0) / 2.0
# Golden section shrinks by 0.618 a step; the distance is flat at its minimum, so half the bits are enough.
_GOLDEN_STEPS: Final = 40
# Path of the tip between two samples over its chord; 1.2 is that of an arc of two radians.
_DETOUR: Final = 1.2


class _Bracket(NamedTuple):
    """A sample nearer to the goal than its neighbours: between these is a local minimum of the distance.

    Attributes:
        distance: distance of the sample from the goal.
        curve: number of the curve.
        at: parameter of the sample.
        low, high: parameters of its neighbours.
        lower_bound: a lower bound of the distance between them.
    """

    distance: float
    curve: int
    at: float
    low: float
    high: float
    lower_bound: float


def nearest_on(curves: Sequence[Curve], pieces: Sequence[Sequence[float]], goal: Vec3) -> tuple[int, float]:
    """Number of the curve and parameter of the point nearest to ``goal``.

    Args:
        curves: x and y over a common parameter; ties go to the first.
        pieces: samples of the parameter, in pieces without a corner of any curve.
        goal: position sought, in the frame and unit of the curves; for NaN the answer is the first sample.
    """
    brackets = sorted(
        bracket
        for number, curve in enumerate(curves)
        for piece in pieces
        for bracket in _brackets(number, curve, piece, goal)
    )
    if not brackets:
        return 0, pieces[0][0]
    best = brackets[0].distance, brackets[0].curve, brackets[0].at
    for bracket in brackets:
        if bracket.lower_bound < best[0]:
            curve = curves[bracket.curve]
            u = _golden_section(curve, goal, bracket)
            best = min(best, (_distance(curve(u), goal), bracket.curve, u))
    return best[1:]


def _brackets(number: int, curve: Curve, samples: Sequence[float], goal: Vec3) -> Iterator[_Bracket]:
    points = [curve(u) for u in samples]
    away = [_distance(point, goal) for point in points]
    last = len(samples) - 1
    # Between two samples no point is nearer than this.
    lower_bounds = [
        0.5 * (away[i] + away[i + 1] - _DETOUR * _distance(points[i], points[i + 1])) for i in range(last)
    ]
    for i, distance in enumerate(away):
        before, after = max(i - 1, 0), min(i + 1, last)
        # A plateau counts once.
        if (i == 0 or distance < away[before]) and distance <= away[after]:
            least = min(lower_bounds[before:after])
            yield _Bracket(distance, number, samples[i], samples[before], samples[after], least)


def _distance(a: Vec3, b: Vec3) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])


def _golden_section(curve: Curve, goal: Vec3, bracket: _Bracket) -> float:
    """Parameter of the point of a curve nearest to ``goal`` between the ends of a bracket."""
    low, high = bracket.low, bracket.high
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
