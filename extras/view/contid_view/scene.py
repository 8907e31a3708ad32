"""What is drawn of one robot file: robots, the ropes between them, the floor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.control.engine.wiring import build_robot_configs
from contid.kinematics.array import Array
from contid.robot_file.clearance import ObstacleDescription, PlaneDescription
from contid.robot_file.load import LoadedFile
from contid.targets import Tip
from contid.units import MM_PER_M
from contid_ropes.chain import ChainGuard
from contid_ropes.file_chains import FileChains
from contid_view.body import SolidBody
from contid_view.robot_scene import RobotDrawing, RobotScene

#: Points of a rope.
POINTS: Final = 33
#: Allowed distances between the lines of the floor [mm], and how many cells the robots may span.
CELLS_MM: Final = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
MAX_CELLS: Final = 20
#: Cells of the grid that stands for a plane, along each side.
PLANE_CELLS: Final = 10


@dataclass(frozen=True)
class Scene:
    """What is drawn.

    Attributes:
        robots: the driven robots, in the order of the records.
        bodies: bodies of the same robots.
        ropes: guards of the closed chains, which compute the shape of their ropes.
        cell_mm: distance between the lines of the floor.
        obstacles: obstacles of the file's ``clearance``, by name.
    """

    robots: Sequence[RobotScene]
    bodies: Sequence[SolidBody]
    ropes: Sequence[ChainGuard]
    cell_mm: float
    obstacles: Mapping[str, ObstacleDescription]

    @property
    def planar(self) -> bool:
        """True when all robots stay in the x-y plane."""
        return all(robot.planar for robot in self.robots)

    def workspace(self) -> Array:
        """Points that the robots are likely to reach, (n, 3) [mm]."""
        return np.vstack([robot.workspace for robot in self.robots])

    def floor(self) -> list[Array]:
        """Lines of a grid at height 0 below the workspace, each (2, 3) [mm]."""
        points, cell = self.workspace()[:, :2], self.cell_mm
        (left, front), (right, back) = np.floor(points.min(axis=0) / cell), np.ceil(points.max(axis=0) / cell)
        across = [[[left, y, 0.0], [right, y, 0.0]] for y in np.arange(front, back + 1.0)]
        along = [[[x, front, 0.0], [x, back, 0.0]] for x in np.arange(left, right + 1.0)]
        return [np.array(line) * cell for line in (*across, *along)]


def build_scene(loaded: LoadedFile, rate_hz: float) -> Scene:
    """All robots and ropes of a file."""
    configs = build_robot_configs(loaded, rate_hz)
    robots = [RobotScene(config, loaded.file.robots[config.name]) for config in configs]
    bodies = [SolidBody(robot, loaded.file.robots[robot.config.name]) for robot in robots]
    size_mm = float(np.max(np.ptp(np.vstack([robot.workspace for robot in robots]), axis=0)))
    cell_mm = next((cell for cell in CELLS_MM if cell * MAX_CELLS >= size_mm), math.ceil(size_mm / MAX_CELLS))
    clearance = loaded.file.clearance
    return Scene(
        robots, bodies, FileChains(loaded).guards, cell_mm, {} if clearance is None else clearance.obstacles
    )


def rope_line(rope: ChainGuard, drawings: Mapping[str, RobotDrawing | None]) -> Array | None:
    """A rope between drawn robots [mm], (n, 3); None if an arm is unknown or the rope too short."""
    tips: dict[str, Tip] = {}
    for arm in rope.arms:
        if (drawing := drawings[arm]) is None:
            return None
        x, y, z = (drawing.tip / MM_PER_M).tolist()
        u, v, w = drawing.frames[-1][3].tolist()
        tips[arm] = ((x, y, z), (u, v, w))
    points = rope.points(tips, POINTS)
    return points * MM_PER_M if len(points) else None


def plane_grid(plane: PlaneDescription, workspace: Array) -> list[Array]:
    """Lines of a grid on a plane, below or beside the workspace [mm, (n, 3)], each (2, 3) [mm]."""
    normal = np.array(plane.normal) / np.linalg.norm(plane.normal)
    middle = 0.5 * (workspace.min(axis=0) + workspace.max(axis=0))
    middle = middle - normal * float((middle - np.array(plane.point_mm)) @ normal)
    reach_mm = 0.5 * float(np.ptp(workspace, axis=0).max())
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    up = np.cross(normal, across)
    lines = []
    for offset_mm in np.linspace(-reach_mm, reach_mm, PLANE_CELLS + 1):
        for aside, along in ((offset_mm * across, reach_mm * up), (offset_mm * up, reach_mm * across)):
            lines.append(np.array([middle + aside - along, middle + aside + along]))
    return lines
