"""The robots as lines for the page: bodies, ropes, reach and floor [mm], in the world frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from contid.control.engine.wiring import chain_guards, clearance_of
from contid.control.tick.preflight.rows import Preflight, Unreachable
from contid.errors import ContidError
from contid.remote.protocol.wire import Fields
from contid.robot_file.load import LoadedFile, load_robot_file
from contid.targets import Actuation
from contid_dynamics.swing import SwingingPose
from contid_panel.described_robot import described_robot, swings
from contid_panel.expectation import Expectation
from contid_panel.obstacles import obstacle_shape
from contid_panel.samples import actuation_of, rounded_line
from contid_view.robot_scene import RobotDrawing, RobotScene
from contid_view.scene import Scene, build_scene, rope_line

#: A commanded body is drawn where it is further from the measured one than this share of the length.
GHOST: Final = 0.02
#: Modes of a body that a page shows.
MODES: Final = 3


class PanelGeometry:
    """What is drawn of the robots of one file.

    Attributes:
        loaded: the robot file.
        scene: the same shapes as in the viewer.
    """

    def __init__(self, loaded: LoadedFile, rate_hz: float) -> None:
        self.loaded = loaded
        self._clearance = clearance_of(loaded)
        self.scene: Scene = build_scene(loaded, rate_hz)
        #: The newest drawing of every robot, measured and commanded.
        self._drawn: dict[tuple[str, str], tuple[Actuation, RobotDrawing | None]] = {}

    @classmethod
    def of(cls, describe: Mapping[str, Any]) -> PanelGeometry:
        """The geometry of the robots that a daemon describes.

        Raises:
            ContidError: its robot file cannot be read here, or has changed since the daemon read it.
        """
        path = Path(str(describe["file"]))
        geometry = cls(load_robot_file(path), float(describe["rate_hz"]))
        axes = {name: robot["axes"] for name, robot in describe["robots"].items()}
        # A daemon of an earlier version has the limits of the axes only.
        same = describe.get("file_sha256", geometry.loaded.sha256) == geometry.loaded.sha256
        if not same or geometry.limits() != axes:
            raise ContidError(f"{path} has changed since the daemon read it; restart the daemon")
        return geometry

    def limits(self) -> Fields:
        """The axes of every robot with their limits, as a daemon describes them."""
        found: Fields = {}
        for robot in self.scene.robots:
            config = robot.config
            ranges = zip(
                config.axis_names, config.model.lower, config.model.upper, config.quantities, strict=True
            )
            found[config.name] = {
                axis: {
                    f"min_{each.unit}": minimum * each.per_si,
                    f"max_{each.unit}": maximum * each.per_si,
                }
                for axis, minimum, maximum, each in ranges
            }
        return found

    def describe(self) -> Fields:
        """What does not change: per robot columns, sizes, reach; floor and obstacles."""
        descriptions, workspace = self.loaded.driven, self.scene.workspace()
        several = len(descriptions) > 1
        return {
            "planar": self.scene.planar,
            "cell_mm": self.scene.cell_mm,
            "floor": [rounded_line(line) for line in self.scene.floor()],
            "bounds": rounded_line(np.array([workspace.min(axis=0), workspace.max(axis=0)])),
            "obstacles": [obstacle_shape(each, workspace) for each in self.scene.obstacles.values()],
            "robots": {
                robot.config.name: described_robot(robot, descriptions[robot.config.name], several)
                for robot in self.scene.robots
            },
        }

    def expectations(self, described: Mapping[str, Any]) -> dict[str, Expectation]:
        """The axes of every robot, to be compared with their commands."""
        configs = {robot.config.name: robot.config for robot in self.scene.robots}
        return {
            name: Expectation(config, described[name]["follow"])
            for name, config in configs.items()
            if "follow" in described[name]  # a daemon of an earlier version has none
        }

    def bodies(
        self,
        measured: Mapping[str, Sequence[float] | None],
        commanded: Mapping[str, Sequence[float] | None],
    ) -> Fields:
        """Lines of every robot and the ropes between them.

        Args:
            measured: axes of every robot, in its units: its body is drawn there.
            commanded: the same; where that body is elsewhere it is drawn too, as a ghost.
        """
        drawings: dict[str, RobotDrawing | None] = {}
        for robot in self.scene.robots:
            values = measured.get(robot.config.name)
            drawings[robot.config.name] = (
                None if values is None else self._drawing(robot, "measured", actuation_of(robot, values))
            )
        found = {
            name: [] if drawing is None else [rounded_line(strip) for strip in drawing.strips]
            for name, drawing in drawings.items()
        }
        ropes = [line for rope in self.scene.ropes if (line := rope_line(rope, drawings)) is not None]
        ghosts = {
            robot.config.name: ghost
            for robot in self.scene.robots
            if (ghost := self._ghost(robot, drawings[robot.config.name], commanded.get(robot.config.name)))
        }
        return {"robots": found, "ghosts": ghosts, "ropes": [rounded_line(line) for line in ropes]}

    def _ghost(
        self, robot: RobotScene, body: RobotDrawing | None, commanded: Sequence[float] | None
    ) -> list[list[list[float]]]:
        """Lines of the commanded body, none where it is not apart from the measured one."""
        if body is None or commanded is None or None in commanded:
            return []
        actuation = actuation_of(robot, commanded)
        there = None if actuation == body.actuation else self._drawing(robot, "commanded", actuation)
        if there is None:
            return []
        apart = float(np.abs(there.backbone - body.backbone).max())
        return [rounded_line(strip) for strip in there.strips] if apart > GHOST * robot.length_mm else []

    def _drawing(self, robot: RobotScene, kind: str, actuation: Actuation) -> RobotDrawing | None:
        """A robot at an actuation, the last one of its kind if that is the same; None outside its model."""
        key = (robot.config.name, kind)
        before = self._drawn.get(key)
        if before is not None and before[0] == actuation:
            return before[1]
        try:
            drawing = robot.drawing(actuation)
        except (ValueError, ArithmeticError):
            drawing = None
        self._drawn[key] = actuation, drawing
        return drawing

    def preflight(self, commands: Mapping[str, Actuation]) -> Preflight:
        """The check of a trajectory from where the robots are."""
        configs = tuple(robot.config for robot in self.scene.robots)
        guards, clearance = chain_guards(self.loaded), self._clearance
        return Preflight(configs, guards, Unreachable.REFUSE, commands, clearance)


def modes(geometry: PanelGeometry, name: str, actuation: Actuation) -> Fields:
    """The modes of a robot that rests under an actuation [m or Pa].

    Returns:
        ``modes``: ``frequency_hz``, ``ratio``, and ``lines`` of the backbone in the world [mm]: to one
        side, at rest, to the other, so large that the farthest point would move by 0.2 of the
        length in proportion.

    Raises:
        ContidError: the robot has no `dynamics`, or no equilibrium was found.
    """
    description = geometry.loaded.driven[name]
    if not swings(description):
        raise ContidError(f"{name} has no dynamics in its robot file: how it swings is not known")
    robot = next(each for each in geometry.scene.robots if each.config.name == name)
    try:
        pose = SwingingPose(description, actuation[: len(description.axis_names)], MODES)
    except ArithmeticError as error:
        raise ContidError(f"{name}: {error}; how it swings here is not known") from None
    found = [
        {
            "frequency_hz": mode.frequency_hz,
            "ratio": mode.ratio,
            "lines": [
                rounded_line(np.asarray(robot.in_world_mm(pose.line_m(k, share))))
                for share in (-1.0, 0.0, 1.0)
            ],
        }
        for k, mode in enumerate(pose.modes.modes)
    ]
    return {"modes": found}
