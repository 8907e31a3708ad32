"""The rigid two-link finger that Morita et al. compare with (section IV-B, Fig. 5 and 6).

Both joints turn by at most A to either side. The paper's "99 degrees" reproduces with these limits only, not
with joints limited to one side ("0 to 120 degrees"): a finding of this project, tested in extras/reach/tests.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

_POINTS: Final = 2000


def two_link_region(joint_limit_rad: float, link_m: float = 0.05) -> BaseGeometry:
    """Region of the tip of two equal links growing along +y from the origin [m].

    In polar coordinates around the base the elbow q2 sets the radius ``2 l cos(q2/2)`` and shifts the
    direction by ``q2/2``: for elbows of one sign the region is a band between two spirals, and the two signs
    mirror each other.
    """
    elbow = np.linspace(0.0, joint_limit_rad, _POINTS)
    shoulder = np.linspace(-joint_limit_rad, joint_limit_rad, _POINTS)
    bent, straight = np.full(_POINTS, joint_limit_rad), np.zeros(_POINTS)
    # Along the boundary: upper shoulder limit, elbow bent, lower shoulder limit, elbow straight.
    shoulders = np.concatenate([bent, shoulder[::-1], -bent, shoulder])
    elbows = np.concatenate([elbow, bent, elbow[::-1], straight])
    direction, distance = shoulders + 0.5 * elbows, 2.0 * link_m * np.cos(0.5 * elbows)
    x, y = distance * np.sin(direction), distance * np.cos(direction)
    one_sign: BaseGeometry = Polygon(np.column_stack([x, y])).buffer(0)
    other_sign: BaseGeometry = Polygon(np.column_stack([-x, y])).buffer(0)
    region: BaseGeometry = one_sign.union(other_sign)
    return region


def two_link_overlap(joint_limit_rad: float, spacing_m: float, link_m: float = 0.05) -> BaseGeometry:
    """Common region of two such fingers side by side [m]."""
    from shapely.affinity import translate

    region = two_link_region(joint_limit_rad, link_m)
    overlap: BaseGeometry = region.intersection(translate(region, xoff=spacing_m))
    return overlap
