"""Distances of bodies to each other, to themselves and to obstacles, bounded from both sides.

The kernel ``contid/kernels/clearance`` bounds the distance between two bodies, and between a body and an
obstacle, by branch and bound. The result holds for the curves between the samples, not only for the samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from contid.kernels import load
from contid_clearance.body import Body
from contid_clearance.obstacles import Obstacle

#: Points of a body may not meet that are this many half turns about its own radius apart along it: a bend as
#: narrow as the body turns by half a turn in one of them, and a seventh more is left to the samples.
SELF_TURNS: Final = 1.15
#: Pieces in that length.
_SELF_PIECES: Final = 16


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
    radii, off_m = a.radius_m + b.radius_m, a.off_m + b.off_m
    enough = enough_m + radii + off_m
    found = load("clearance").between(a.points, a.spacing_m, b.points, b.spacing_m, enough)
    at_m = a.start_m + found.at * a.spacing_m
    return Distance(found.lower - radii - off_m, found.upper - radii + off_m, at_m)


def to_obstacle(body: Body, obstacle: Obstacle, enough_m: float = math.inf) -> Distance:
    """Distance between the surfaces of a body and of a convex obstacle [m].

    Args:
        body: the body.
        obstacle: a convex set.
        enough_m: stop halving as soon as the distance is certainly at least this.
    """
    radius_m, off_m = body.radius_m, body.off_m
    enough = enough_m + radius_m + off_m
    found = load("clearance").to_obstacle(body.points, body.spacing_m, obstacle.packed, enough)
    at_m = body.start_m + found.at * body.spacing_m
    return Distance(found.lower - radius_m - off_m, found.upper - radius_m + off_m, at_m)


def to_itself(body: Body, margin_m: float, enough_m: float = math.inf) -> Distance:
    """Distance between surfaces of a body that are far enough apart along it [m].

    Neighbours along the body always touch. Two points count when the way between them is longer than a half
    turn of the body about itself, at the margin; a bend no narrower than that keeps such points apart. A
    body without such points keeps the margin, and what it has to get longer for some.

    Args:
        body: the body.
        margin_m: distance that a bend as narrow as the body leaves inside [m].
        enough_m: stop halving as soon as the distance is certainly at least this.
    """
    gap_m = SELF_TURNS * math.pi * (body.radius_m + 0.5 * margin_m)
    too_short_m = gap_m - body.pieces * body.spacing_m
    if too_short_m >= 0.0:
        return Distance(margin_m + too_short_m, math.inf, 0.0)
    fine = body.divided(gap_m / _SELF_PIECES)
    gap = math.floor(gap_m / fine.spacing_m)
    wide_m = 2.0 * (fine.radius_m + fine.off_m)
    found = load("clearance").itself(fine.points, fine.spacing_m, gap, enough_m + wide_m)
    at_m = fine.start_m + found.at * fine.spacing_m
    return Distance(found.lower - wide_m, found.upper - 2.0 * (fine.radius_m - fine.off_m), at_m)
