"""Bounds of the distance between two bodies, and between a body and an obstacle, by branch and bound.

The kernel ``contid/kernels/clearance`` computes them. The result holds for the curves between the samples,
not only for the samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from contid.clearance.body import Body
from contid.clearance.obstacles import Obstacle
from contid.kernels import load


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
