"""Everything there is to draw of one robot file: robots, the ropes between them, the floor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.control.engine.wiring import build_robot_configs, chain_guards
from contid.control.tick.config import RobotConfig
from contid.kinematics.rope.chain import ChainGuard, Tip
from contid.robot_file.load import LoadedFile
from contid.units import MM_PER_M
from contid.view.scene import Array, Look, Scene

#: Points of a rope.
POINTS: Final = 33
#: Distances between the lines of the floor [mm], and how many of them the robots' size may be.
CELLS_MM: Final = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
CELLS: Final = 20


@dataclass(frozen=True)
class RopeDrawing:
    """The rope of a closed chain.

    Attributes:
        guard: knows where it is.
        arms: its two arms, by their place among the robots.
    """

    guard: ChainGuard
    arms: tuple[int, int]

    def line(self, looks: Sequence[Look | None]) -> Array | None:
        """Where it is [mm], (n, 3), for robots that look so; None when that is unknown or too short."""
        tips: dict[str, Tip] = {}
        for name, arm in zip(self.guard.arms, self.arms, strict=True):
            if (look := looks[arm]) is None:
                return None
            x, y, z = (look.tip / MM_PER_M).tolist()
            u, v, w = look.frames[-1][3].tolist()
            tips[name] = ((x, y, z), (u, v, w))
        points = self.guard.points(tips, POINTS)
        return points * MM_PER_M if len(points) else None


@dataclass(frozen=True)
class Stage:
    """What is drawn.

    Attributes:
        scenes: the driven robots, in the order of the records.
        ropes: of the closed chains.
        cell_mm: distance between the lines of the floor.
    """

    scenes: Sequence[Scene]
    ropes: Sequence[RopeDrawing]
    cell_mm: float

    @property
    def planar(self) -> bool:
        """True when all of it stays in a plane."""
        return all(scene.planar for scene in self.scenes)

    def seen(self) -> Array:
        """Points that the robots are likely to come to, (n, 3) [mm]."""
        return np.vstack([scene.seen for scene in self.scenes])

    def floor(self) -> list[Array]:
        """Lines of a grid at height 0, as far as the robots reach, each (2, 3) [mm]."""
        seen, cell = self.seen()[:, :2], self.cell_mm
        (left, front), (right, back) = np.floor(seen.min(axis=0) / cell), np.ceil(seen.max(axis=0) / cell)
        across = [[[left, y, 0.0], [right, y, 0.0]] for y in np.arange(front, back + 1.0)]
        along = [[[x, front, 0.0], [x, back, 0.0]] for x in np.arange(left, right + 1.0)]
        return [np.array(line) * cell for line in (*across, *along)]


def build_stage(loaded: LoadedFile, rate_hz: float) -> Stage:
    """All robots and ropes of a file."""
    configs: Sequence[RobotConfig] = build_robot_configs(loaded, rate_hz)
    scenes = [Scene(config, loaded.file.robots[config.name]) for config in configs]
    places = {config.name: index for index, config in enumerate(configs)}
    ropes = [
        RopeDrawing(guard, (places[guard.arms[0]], places[guard.arms[1]])) for guard in chain_guards(loaded)
    ]
    size_mm = float(np.ptp(np.vstack([scene.seen for scene in scenes]), axis=0).max())
    cell_mm = next((cell for cell in CELLS_MM if cell * CELLS >= size_mm), math.ceil(size_mm / CELLS))
    return Stage(scenes, ropes, cell_mm)
