"""Tendons seen from the shafts that wind them up: stiffness and backlash in angles, for emulated devices.

The transmission is affine, and the angle of a shaft depends on the pull of its own tendon only. So the angles
at two sets of pulls, 0 and 1 m, give the gain ``c = d angle / d pull`` [rad/m] of every tendon. The work of a
tendon is the same in both coordinates: a stiffness k [N/m] on the pull is ``k / c^2`` [N m/rad] on the angle.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from contid.hal import SpooledTendon
from contid.kinematics.tendon.described import geometry_of, statics_of
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Actuation


def spooled_tendons(
    robot: TendonRobot, to_device: Callable[[Actuation], Actuation]
) -> tuple[SpooledTendon, ...]:
    """Describe the tendons of a robot in angles of their shafts, section by section.

    Args:
        robot: description of the robot.
        to_device: transmission of the robot: pulls [m] and values of extra axes to angles [rad], affine.

    Returns:
        A tendon for each pull, in the order of the axes; empty without ``tension`` in the robot file.
    """
    geometry = geometry_of(robot)
    statics = statics_of(robot, geometry)
    if statics is None:
        return ()
    axes = len(robot.all_axis_names)
    zero_pulls, unit_pulls = (0.0,) * axes, (1.0,) * axes
    angles_at_zero, angles_at_unit = np.array(to_device(zero_pulls)), np.array(to_device(unit_pulls))
    rad_per_m = (angles_at_unit - angles_at_zero)[: geometry.tendons]
    angles_by_bends = geometry.pull_matrix * rad_per_m[:, None]
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
