"""Draws the compliance of a tip as an ellipsoid: the displacements under one small force in any direction.

Its half axes are the singular values of the compliance of the model at the command, times the force.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import rerun as rr

from contid.kinematics.array import Array
from contid.kinematics.model import Compliant
from contid.targets import Actuation, Vec3
from contid.units import MM_PER_M
from contid_view import paths
from contid_view.body import quaternion_of
from contid_view.colours import COMPLIANCE
from contid_view.rerun.stream import RerunStream
from contid_view.robot_scene import RobotScene

#: Greatest half axis at rest, as a share of the robot's length.
_SHARE: Final = 0.1


def scale_force_n(softest_mm_per_n: float, length_mm: float) -> float:
    """The force of 1, 2 or 5 times a power of ten that moves a tip by at most 10 % of the length [N]."""
    most = _SHARE * length_mm / softest_mm_per_n
    power = 10.0 ** math.floor(math.log10(most))
    return max(step for step in (1.0, 2.0, 5.0) if step * power <= most * (1.0 + 1e-9)) * power


class RerunCompliance:
    """The ellipsoid of one robot in a recording."""

    def __init__(self, stream: RerunStream, robot: RobotScene, model: Compliant) -> None:
        self._stream, self._robot, self._model = stream, robot, model
        self._entity = paths.body(robot.config.name, "compliance")
        self._rotation = np.array(robot.config.frame.rotation).reshape(3, 3)
        softest = float(np.linalg.norm(model.compliance(robot.config.rest), 2)) * MM_PER_M
        self.force_n = scale_force_n(softest, robot.length_mm)
        look = rr.Ellipsoids3D.from_fields(
            colors=[COMPLIANCE],
            line_radii=rr.Radius.ui_points(0.5),
            labels=[f"{self.force_n * 1e3:g} mN"],
            show_labels=False,
        )
        stream.static(self._entity, look)

    def write(
        self,
        ticks: Sequence[int],
        commands: Sequence[Actuation],
        loads: Sequence[Vec3],
        tips: Sequence[Array],
    ) -> None:
        """The ellipsoid at every tick with a command; tips [mm] and loads [N] in the world."""
        halves, quaternions, centres, shown = [], [], [], []
        for tick, command, load, tip in zip(ticks, commands, loads, tips, strict=True):
            if not (all(map(math.isfinite, command)) and np.isfinite(tip).all()):
                continue
            compliance = self._model.compliance(command, self._robot.config.frame.vector_in_base(load))
            if not np.isfinite(compliance).all():
                continue
            axes, sizes, _ = np.linalg.svd(self._rotation @ compliance)
            axes[:, 2] *= np.sign(np.linalg.det(axes))
            halves.append(sizes * MM_PER_M * self.force_n)
            quaternions.append(quaternion_of(axes))
            centres.append(tip)
            shown.append(tick)
        if shown:
            columns = rr.Ellipsoids3D.columns(
                half_sizes=np.array(halves, dtype=np.float32),
                centers=np.array(centres, dtype=np.float32),
                quaternions=np.array(quaternions, dtype=np.float32),
            )
            self._stream.send(self._entity, shown, columns)
