"""Sections of tendon robots for tests."""

from __future__ import annotations

import math

from contid.kinematics.tendon.geometry import TendonSection


def even_section(
    length_m: float, radius_m: float, tendons: int = 3, first_rad: float = 0.0, rigid_m: float = 0.0
) -> TendonSection:
    """A section whose tendons stand evenly around the backbone, from the azimuth ``first_rad`` on."""
    angles = tuple(first_rad + 2.0 * math.pi * i / tendons for i in range(tendons))
    return TendonSection(length_m, (radius_m,) * tendons, angles, rigid_m)
