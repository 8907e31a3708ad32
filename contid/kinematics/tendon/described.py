"""Geometry and balance of tensions of the description of a robot, in SI."""

from __future__ import annotations

import math

import numpy as np

from contid.kinematics.tendon.geometry import TendonGeometry, TendonSection
from contid.kinematics.tendon.tension import TendonStatics
from contid.robot_file.tendon.robot import TendonRobot
from contid.units import MM_PER_M


def geometry_of(robot: TendonRobot) -> TendonGeometry:
    """Geometry of a robot description."""
    sections = tuple(
        TendonSection(
            section.length_mm / MM_PER_M,
            section.radius_m,
            tuple(math.radians(angle) for angle in section.angles_deg),
            section.rigid_mm / MM_PER_M,
        )
        for section in robot.geometry.sections
    )
    through = robot.geometry.routing == "through"
    return TendonGeometry(sections, through, robot.geometry.base_offset_mm / MM_PER_M, robot.tip_offset_m)


def statics_of(robot: TendonRobot, geometry: TendonGeometry) -> TendonStatics | None:
    """Balance of tensions of a robot description; None where it has none."""
    tension = robot.tension
    if tension is None:
        return None
    bending = robot.per_section(tension.bending_n_mm2)
    stiffness = robot.per_section(tension.tendon_n_per_mm)
    return TendonStatics(
        geometry,
        tuple(
            ei / (MM_PER_M * MM_PER_M) / section.length_m
            for ei, section in zip(bending, geometry.sections, strict=True)
        ),
        MM_PER_M * np.array(stiffness)[geometry.section_of],
        tension.floor_n,
        tension.max_n,
    )
