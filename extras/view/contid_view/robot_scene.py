"""The geometry of one robot for drawings: lines, frames and limits in the world frame, in mm, for any model.

It needs only the model protocol; planar fingers add the edges of their body and the outline of their reach,
tendon robots their tendons and discs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.control.tick.config import RobotConfig
from contid.kinematics.array import Array
from contid.kinematics.model import build_model
from contid.kinematics.rack.finger import RackFingerModel
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.rack_finger import RackFinger
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import ZERO3, Actuation, Vec3
from contid.units import MM_PER_M
from contid_view.tendon_lines import tendon_lines
from contid_view.transport import tangents, transported

#: Points of a backbone, and of each of the three curves around a finger's reach.
POINTS: Final = 33
OUTLINE: Final = 100
#: Arrows of a drawn frame, as a fraction of the robot's length.
ARROW: Final = 0.08
#: Sideways motion of a point of a spatial arm, as a fraction of its distance from the base.
SWAY: Final = 0.5


@dataclass(frozen=True, slots=True)
class RobotDrawing:
    """One robot at one actuation.

    Attributes:
        actuation: [m or Pa].
        strips: sections of the backbone from base to tip, then the edges of the body or the tendons and
            discs around it, each (n, 3) [mm].
        frames: origin and three axes of length 1 as rows, (4, 3), of the mid-point (if any) and the tip.
        sections: how many of the strips are of the backbone.
    """

    actuation: Actuation
    strips: list[Array]
    frames: list[Array]
    sections: int

    @property
    def tip(self) -> Array:
        """Tip of the backbone [mm]."""
        tip: Array = self.frames[-1][0]
        return tip

    @property
    def backbone(self) -> Array:
        """Points of the backbone, each once, as its sections share a point; (n, 3) [mm]."""
        first, *others = self.strips[: self.sections]
        return np.concatenate([first, *(strip[1:] for strip in others)])

    @property
    def backbone_mm(self) -> float:
        """Length of the backbone [mm]."""
        return sum(map(_length, self.strips[: self.sections]))


class RobotScene:
    """One robot.

    Attributes:
        config: configuration of the robot.
        length_mm: length of the backbone at rest or in the middle of its range, the larger of the two.
        outline: closed line around the reach of a planar finger [mm], None for other robots.
        workspace: points that the robot is likely to reach, (n, 3) [mm]; the camera shows them all.
        groups: axes that share a plot, by the prefix of its entities; extra axes have their own.
        up: up direction of the camera in the world frame; opposite to ``down`` of the file.
    """

    def __init__(self, config: RobotConfig, robot: RobotDescription) -> None:
        self.config = config
        self._rotation = np.array(config.frame.rotation).reshape(3, 3)
        self._origin = np.array(config.frame.origin_in_world)
        own, count = len(config.axis_names) - len(robot.extra_axis_names), len(config.axis_names)
        turning = count - len(robot.extra_deg)
        self.groups = {"": slice(0, own)}
        if own < turning:
            self.groups["extra_"] = slice(own, turning)
        if turning < count:
            self.groups["angle_"] = slice(turning, count)
        self._spacing_m = 0.0
        self.outline: Array | None = None
        x, y, z = robot.down_unit
        self.up: Vec3 = (0.0 - x, 0.0 - y, 0.0 - z)
        halfway = tuple(0.5 * (a + b) for a, b in zip(config.model.lower, config.model.upper, strict=True))
        lines = [config.model.shape(actuation, POINTS) for actuation in (config.rest, halfway)]
        self.length_mm = max(map(_length, lines)) * MM_PER_M
        if isinstance(robot, RackFinger):
            self._spacing_m = robot.geometry.rack_spacing_mm / MM_PER_M
            self.outline = self._outline(robot)
            self.workspace = np.vstack([self.in_world_mm(lines[0]), self.outline])
        else:
            self.workspace = self.in_world_mm(_swayed(np.vstack(lines)))
        model = build_model(robot) if isinstance(robot, TendonRobot) else None
        self._tendons = model if isinstance(model, TendonModel) else None

    @property
    def planar(self) -> bool:
        """True when the robot stays in its x-y plane."""
        return self.config.model.dimension == 2

    @property
    def base(self) -> Array:
        """The base frame: origin and axes of length 1, (4, 3)."""
        return np.vstack([self.in_world_mm(np.zeros((1, 3))), self._rotation.T])

    def drawing(self, actuation: Actuation, load_in_world: Vec3 = ZERO3) -> RobotDrawing | None:
        """The robot at an actuation and a known tip load.

        None if an axis is unknown, or if the model has no answer there, as for a reading far out of range.
        """
        if not all(map(math.isfinite, actuation)):
            return None
        load = self.config.frame.vector_in_base(load_in_world)
        try:
            line = self.config.model.shape(actuation, POINTS, load)
            pose = self.config.model.forward(actuation, load)
        except (ValueError, ArithmeticError):
            return None
        frames = [np.vstack([self.in_world_mm(np.array([pose.tip_m])), self._turned(pose.rotation)])]
        sections = [line]
        cut = int(np.argmin(np.linalg.norm(line - np.array(pose.mid_m), axis=1)))
        if 0 < cut < POINTS - 1:
            sections = [line[: cut + 1], line[cut:]]
            across, along = np.eye(3)[[0, 1 if self.planar else 2]]
            x, y, z = (axes[0] for axes in transported(sections[0][None], across, along))
            begin, end = (np.stack([x[k], y[k], z[k]], axis=1) for k in (0, -1))
            turned = self._turned((end @ begin.T).ravel().tolist())
            frames.insert(0, np.vstack([self.in_world_mm(line[cut : cut + 1]), turned]))
        around = (
            self._edges(line)
            if self._tendons is None
            else tendon_lines(self._tendons, np.array(actuation[: len(self._tendons.axis_names)]))
        )
        strips = [self.in_world_mm(part) for part in (*sections, *around)]
        return RobotDrawing(actuation, strips, frames, len(sections))

    def _edges(self, line: Array) -> Sequence[Array]:
        """Left and right edge of a planar body."""
        if not self._spacing_m:
            return ()
        along = tangents(line)
        across = 0.5 * self._spacing_m * np.stack([-along[:, 1], along[:, 0], along[:, 2]], axis=1)
        return (line + across, line - across)

    def _outline(self, robot: RackFinger) -> Array:
        model = RackFingerModel(robot)
        racks = list(model.envelope.outline(OUTLINE))
        return self.in_world_mm(np.array([model.forward(pair).tip_m for pair in (*racks, racks[0])]))

    def _turned(self, rotation: Sequence[float]) -> Array:
        """Axes of a frame given in the base frame, as rows in the world."""
        turned: Array = np.array(rotation).reshape(3, 3).T @ self._rotation.T
        return turned

    def in_world_mm(self, points_in_base: Array) -> Array:
        """Points [m] in the base frame -> [mm] in the world."""
        world: Array = (points_in_base @ self._rotation.T + self._origin) * MM_PER_M
        return world


def _length(line: Array) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def _swayed(points: Array) -> Array:
    """Points of an arm along z, and their positions when it leans to each of four sides."""
    far = SWAY * np.linalg.norm(points, axis=1)[:, None]
    sides = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    swayed: Array = np.vstack([points, *(points + far * side for side in sides)])
    return swayed
