"""Exact reach of planar fingers: the boundary of the tip's region as a fine polygon.

Inside its limits a finger's inverse is unique (`contid.kinematics.rack.finger`), so the tip's region is the
one-to-one image of the limits in (S, k), arc length and curvature, and the image of their boundary is the
boundary of the region. The area error of a polygon of n points is O(1/n^2); the number used here makes the
fourth decimal of a cm^2 exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, make_valid
from shapely.geometry.base import BaseGeometry

from contid.kinematics.rack.finger import RackFingerModel
from contid.robot_file.base import BasePose

_POINTS_PER_CURVE: Final = 16_000
_SAME_POINT_M: Final = 1e-12


def area_cm2(region: BaseGeometry) -> float:
    """Area in cm^2 of a region given in m."""
    return float(region.area) * 1e4


def finger_region(model: RackFingerModel, points: int = _POINTS_PER_CURVE) -> BaseGeometry:
    """Region of one finger's tip in its base frame [m].

    A tip body of length h may curl back to less than h from the base. The outline then crosses itself at
    (0, -h): it is a figure eight, and both loops belong to the region.
    """
    outline = np.array([model.forward(racks).tip_m[:2] for racks in model.envelope.outline(points)])
    # All points of a full turn coincide; rounding would turn them into many tiny loops.
    moved = np.linalg.norm(np.diff(outline, axis=0, prepend=outline[-1:]), axis=1) > _SAME_POINT_M
    region: BaseGeometry = make_valid(Polygon(outline[moved]))
    return region


def to_world(region: BaseGeometry, base: BasePose) -> BaseGeometry:
    """A region in the base frame -> the world frame; only x and y of the pose count in the plane."""
    from shapely import transform

    rotation = np.array(base.rotation).reshape(3, 3)[:2, :2]
    shift = np.array(base.position_m[:2])

    def move(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(xy @ rotation.T + shift)

    placed: BaseGeometry = transform(region, move)
    return placed


def planar_regions(
    models: Mapping[str, RackFingerModel], bases: Mapping[str, BasePose]
) -> dict[str, BaseGeometry]:
    """Regions of the tips of several fingers in the world frame [m]; that of one model is computed once."""
    regions = {model: finger_region(model) for model in {*models.values()}}
    return {name: to_world(regions[model], bases[name]) for name, model in models.items()}


def overlapping(regions: Mapping[str, BaseGeometry]) -> dict[tuple[str, str], BaseGeometry]:
    """The intersection of every two regions."""
    return {(a, b): regions[a].intersection(regions[b]) for a, b in combinations(regions, 2)}
