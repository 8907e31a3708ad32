"""The description of a tendon robot in SI: geometry, balance of tensions, tendons on their spools."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from contid.hal import SpooledTendon
from contid.kinematics.tendon.geometry import TendonGeometry, TendonSection
from contid.kinematics.tendon.tension import TendonStatics
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Actuation
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


def spooled_tendons(
    robot: TendonRobot, to_device: Callable[[Actuation], Actuation]
) -> tuple[SpooledTendon, ...]:
    """The tendons of a robot, section by section; none without ``tension`` in its file.

    Args:
        robot: its description.
        to_device: its transmission, pulls [m] and extra axes to angles [rad].
    """
    geometry = geometry_of(robot)
    statics = statics_of(robot, geometry)
    if statics is None:
        return ()
    none = (0.0,) * len(robot.all_axis_names)
    unit = tuple(1.0 for _ in none)
    here, there = np.array(to_device(none)), np.array(to_device(unit))
    rad_per_m = (there - here)[: geometry.tendons]
    bends = geometry.pull_matrix * rad_per_m[:, None]
    bending = tuple(np.repeat(statics.bending_nm, 2).tolist())
    backlash = robot.backlash or (0.0,) * geometry.tendons
    return tuple(
        SpooledTendon(k / gain**2, tuple(row.tolist()), bending, r * abs(gain), robot.capstan or ())
        for k, gain, row, r in zip(
            statics.tendon_n_per_m.tolist(), rad_per_m.tolist(), bends, backlash, strict=True
        )
    )
