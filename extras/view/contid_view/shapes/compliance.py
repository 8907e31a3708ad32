"""Draws the compliance of a tip as an ellipsoid: where one small force in any direction would move it.

The compliance C [m/N] is the derivative of the tip position by a force on the tip, at the command, shape (3,
3). Forces of size f in all directions move the tip to an ellipsoid. With ``C = U S V^T`` its half axes are
the columns of U, of the lengths ``f S``.
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

#: Greatest half axis of the robot at rest, as a share of its length.
_SHARE: Final = 0.1


def scale_force_n(softest_mm_per_n: float, length_mm: float) -> float:
    """The force of 1, 2 or 5 times a power of ten that moves a tip by at most 10 % of the length [N]."""
    limit_n = _SHARE * length_mm / softest_mm_per_n
    power = 10.0 ** math.floor(math.log10(limit_n))
    return max(step for step in (1.0, 2.0, 5.0) if step * power <= limit_n * (1.0 + 1e-9)) * power


class RerunCompliance:
    """The ellipsoid of one robot in a recording.

    Attributes:
        force_n: the force whose displacements are drawn [N]; the same in the whole recording.
    """

    def __init__(self, stream: RerunStream, robot: RobotScene, model: Compliant) -> None:
        self._stream, self._robot, self._model = stream, robot, model
        self._entity = paths.body(robot.config.name, "compliance")
        self._rotation = np.array(robot.config.frame.rotation).reshape(3, 3)
        softest_mm_per_n = float(np.linalg.norm(model.compliance(robot.config.rest), 2)) * MM_PER_M
        self.force_n = scale_force_n(softest_mm_per_n, robot.length_mm)
        appearance = rr.Ellipsoids3D.from_fields(
            colors=[COMPLIANCE],
            line_radii=rr.Radius.ui_points(0.5),
            labels=[f"{self.force_n * 1e3:g} mN"],
            show_labels=False,
        )
        stream.static(self._entity, appearance)

    def write(
        self,
        ticks: Sequence[int],
        commands: Sequence[Actuation],
        loads: Sequence[Vec3],
        tips: Sequence[Array],
    ) -> None:
        """Write the ellipsoids of some ticks; one without a command or a tip has none.

        Args:
            ticks: numbers of the ticks; the other arguments have one entry for each.
            commands: commanded actuations [m or Pa], NaN before the first.
            loads: known forces on the tip in the world [N].
            tips: positions of the tip in the world [mm], shape (3,).
        """
        halves, quaternions, centres, shown = [], [], [], []
        for tick, command, load, tip in zip(ticks, commands, loads, tips, strict=True):
            if not (all(map(math.isfinite, command)) and np.isfinite(tip).all()):
                continue
            compliance = self._model.compliance(command, self._robot.config.frame.vector_in_base(load))
            if not np.isfinite(compliance).all():
                continue
            axes, singular_values, _ = np.linalg.svd(self._rotation @ compliance)
            axes[:, 2] *= np.sign(np.linalg.det(axes))  # a rotation, no reflection
            halves.append(singular_values * MM_PER_M * self.force_n)
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
