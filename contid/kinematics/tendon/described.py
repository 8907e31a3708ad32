"""The description of a tendon robot in SI: geometry, balance of tensions, tendons on their spools."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from contid.hal import SpooledTendon
from contid.kinematics.array import Array
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
    stiffness = np.array(robot.per_section(tension.tendon_n_per_mm))
    if tension.spring_n_per_mm is not None:
        springs = np.array(robot.per_section(tension.spring_n_per_mm))
        stiffness = stiffness * springs / (stiffness + springs)
    return TendonStatics(
        geometry,
        tuple(
            ei / (MM_PER_M * MM_PER_M) / section.length_m
            for ei, section in zip(bending, geometry.sections, strict=True)
        ),
        MM_PER_M * stiffness[geometry.section_of],
        # The least tension of the straight robot at zero pulls (`TendonStatics.rest_n`): with drives
        # ``pretension_n``, with a motor per tendon the floor of the commands.
        tension.commanded_floor_n if tension.pretension_n is None else tension.pretension_n,
        tension.max_n,
    )


def bend_max_of(robot: TendonRobot) -> tuple[float, ...]:
    """Largest bend of every section of a robot description [rad]."""
    return tuple(math.radians(bend) for bend in robot.per_section(robot.limits.bend_max_deg))


def bends_by_pulls(geometry: TendonGeometry, statics: TendonStatics | None) -> Array:
    """Bends that pulls give [rad/m], shape ``(2 sections, tendons)``.

    By the balance of tensions; without one, those whose pulls differ least from the given ones, by squares.
    """
    if statics is not None:
        return statics.bends_by_pulls
    return np.asarray(np.linalg.pinv(geometry.pull_matrix), dtype=np.float64)


def spooled_tendons(
    robot: TendonRobot, to_device: Callable[[Actuation], Actuation]
) -> tuple[SpooledTendon, ...]:
    """Describe the tendons of a robot in angles of their shafts, section by section, for emulated devices.

    The transmission is affine, and the angle of a shaft depends on the pull of its own tendon only. So the
    angles at two sets of pulls, 0 and 1 m, give the gain ``c = d angle / d pull`` [rad/m] of every tendon.
    The work of a tendon is the same in both: a stiffness k [N/m] on the pull is ``k / c^2`` [N m/rad] on the
    angle.

    Args:
        robot: description of the robot.
        to_device: transmission of the robot: pulls [m] and values of extra axes to angles [rad], affine.

    Returns:
        A tendon for each pull, in the order of the axes; empty without ``tension`` in the robot file, and for
        drives, which move several tendons each.
    """
    if robot.drives is not None:
        return ()
    geometry = geometry_of(robot)
    statics = statics_of(robot, geometry)
    if statics is None:
        return ()
    axes = len(robot.all_axis_names)
    zero_pulls, unit_pulls = (0.0,) * axes, (1.0,) * axes
    angles_at_zero, angles_at_unit = np.array(to_device(zero_pulls)), np.array(to_device(unit_pulls))
    rad_per_m = (angles_at_unit - angles_at_zero)[: geometry.tendons]
    angles_by_bends = geometry.pull_matrix * rad_per_m[:, None]  # [rad/rad]
    bending_nm = tuple(np.repeat(statics.bending_nm, 2).tolist())  # a section has two bends, equally stiff
    half_backlash_m = robot.backlash or (0.0,) * geometry.tendons
    return tuple(
        SpooledTendon(
            stiffness_nm=n_per_m / gain**2,
            bends=tuple(by_bends.tolist()),
            bending_nm=bending_nm,
            backlash_rad=half_width_m * abs(gain),
            capstan=robot.capstan or (),
        )
        for n_per_m, gain, by_bends, half_width_m in zip(
            statics.tendon_n_per_m.tolist(), rad_per_m.tolist(), angles_by_bends, half_backlash_m, strict=True
        )
    )
