"""A plane of a robot file, in the base frame of a robot."""

from __future__ import annotations

import math

from contid.robot_file.base import BasePose
from contid.robot_file.clearance import PlaneDescription
from contid.units import MM_PER_M


def plane_in_base(plane: PlaneDescription, base: BasePose) -> tuple[tuple[float, float, float], float]:
    """Unit normal of a plane in the base frame, and the distance of the plane from the base along it [mm]."""
    length = math.hypot(*plane.normal)
    turn, origin = base.rotation, [MM_PER_M * v for v in base.position_m]
    unit = [v / length for v in plane.normal]
    x, y, z = (sum(turn[3 * i + j] * unit[i] for i in range(3)) for j in range(3))
    offset = sum(n * (p - o) for n, p, o in zip(unit, plane.point_mm, origin, strict=True))
    return (x, y, z), offset
