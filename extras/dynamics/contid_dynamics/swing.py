"""The body at a pose, swinging in one of its modes: lines for what draws them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.robot_file.robot import RobotDescription
from contid.units import MM_PER_M
from contid_dynamics.report import PoseModes, modes_of, pose_arm
from contid_dynamics.rod import STRAINS

#: Largest displacement of a drawn mode, as a share of the length of the body, where it grows in proportion.
AMPLITUDE: Final = 0.2


class SwingingPose:
    """The modes of a robot at a pose, and its backbone as it swings in them.

    Args:
        robot: its description, with ``dynamics``.
        actuation: under which it rests [m or Pa].
        count: modes, slowest first.
        payload_g: a mass on the tip besides that of the file.

    Attributes:
        modes: their numbers.

    Raises:
        ContidError: the robot has no moving body.
        ArithmeticError: no equilibrium was found.
    """

    def __init__(
        self, robot: RobotDescription, actuation: Sequence[float], count: int, payload_g: float = 0.0
    ) -> None:
        self._arm = pose_arm(robot, payload_g)
        self._arm.settle(actuation)
        found = self._arm.rod.modes()
        self.modes: PoseModes = modes_of(self._arm, found, count)
        self._strain = self._arm.rod.strain
        nodes = np.array(self.modes.nodes_mm) / MM_PER_M
        reach_m = AMPLITUDE * float(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum())
        self._ways = []
        for shape, mode in zip(found.strain, self.modes.modes, strict=False):
            change = np.zeros((self._arm.rod.count, STRAINS))
            change[:, : self._arm.rod.elements.strains] = shape.reshape(self._arm.rod.count, -1)
            self._ways.append(reach_m / mode.per_unit_m * change)

    def line_m(self, mode: int, share: float) -> Array:
        """The backbone ``(points, 3)`` in the base frame, from the base to the tip.

        Args:
            mode: its number, from 0 on.
            share: of the drawn amplitude, from -1 to 1: the strains change by as much of the mode's.
        """
        rod = self._arm.rod
        rod.put(self._strain + share * self._ways[mode])
        line: Array = np.vstack([rod.poses[:, :3], self._arm.tip_m])
        rod.put(self._strain)
        return line
