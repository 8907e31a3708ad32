"""Tendons as the devices of a robot wind them up: what an emulator needs for the load on its shafts."""

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
