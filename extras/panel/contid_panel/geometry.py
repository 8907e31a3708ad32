"""The robots as lines for the page: bodies, ropes, reach and floor [mm], in the world frame."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from contid.control.engine.wiring import chain_guards, clearance_guard
from contid.control.tick.preflight.rows import Preflight, Unreachable
from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.model import Bending
from contid.remote.protocol.wire import Fields
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import LoadedFile, load_robot_file
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tendon.robot import TendonRobot
from contid.robot_file.tri_rack import TriRack
from contid.targets import Actuation, Target
from contid.trajectory.arc_columns import arc_names, arc_values
from contid.trajectory.columns import column_groups
from contid.units import MM_PER_M
from contid_panel.obstacles import obstacle_shape
from contid_panel.rates import axis_rates, bend_rates, tip_rate_mm_s
from contid_panel.reach_surface import reach_surface
from contid_view.body_plan import SLENDERNESS
from contid_view.robot_scene import RobotDrawing, RobotScene
from contid_view.scene import Scene, build_scene, rope_line
from contid_view.tendon_lines import DISCS, RIM

#: Random actuations whose tips show the reach of a spatial arm; always the same ones.
REACH_TIPS: Final = 500
#: Of them, how many show the rates of columns.
RATE_SAMPLES: Final = 20
#: Steps of the search for an extreme tip, as shares of the range of an axis.
EXTREME_STEPS: Final = (1.0, 0.5, 0.25, 0.1, 0.1, 0.03)
#: Actuations from which it begins.
EXTREME_STARTS: Final = 5
#: A commanded body is drawn where it is further from the measured one than this share of the length.
GHOST: Final = 0.02
#: Decimals of coordinates [mm].
DECIMALS: Final = 2


class PanelGeometry:
    """What is drawn of the robots of one file.

    Attributes:
        loaded: the robot file.
        scene: the same shapes as in the viewer.
    """

    def __init__(self, loaded: LoadedFile, rate_hz: float) -> None:
        self.loaded = loaded
        self._clearance = clearance_guard(loaded)
        self.scene: Scene = build_scene(loaded, rate_hz)
        self._drawn: dict[str, tuple[Actuation, RobotDrawing | None]] = {}

    @classmethod
    def of(cls, describe: Mapping[str, Any]) -> PanelGeometry:
        """The geometry of the robots that a daemon describes.

        Raises:
            ContidError: its robot file cannot be read here, or has changed since the daemon read it.
        """
        path = Path(str(describe["file"]))
        geometry = cls(load_robot_file(path), float(describe["rate_hz"]))
        if geometry.limits() != {name: robot["axes"] for name, robot in describe["robots"].items()}:
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
        descriptions = self.loaded.driven
        several, workspace = len(descriptions) > 1, self.scene.workspace()
        return {
            "planar": self.scene.planar,
            "cell_mm": self.scene.cell_mm,
            "floor": [_line(line) for line in self.scene.floor()],
            "bounds": _line(np.array([workspace.min(axis=0), workspace.max(axis=0)])),
            "obstacles": [obstacle_shape(each, workspace) for each in self.scene.obstacles.values()],
            "robots": {
                robot.config.name: self._robot(robot, descriptions[robot.config.name], several)
                for robot in self.scene.robots
            },
        }

    def _robot(self, robot: RobotScene, description: RobotDescription, several: bool) -> Fields:
        config = robot.config
        groups = column_groups(f"{config.name}." if several else "", description)
        axes = [*groups.get("actuation", []), *groups.get("extra", [])]
        bends = _bends(robot, description, f"{config.name}." if several else "")
        rest = [value * each.per_si for value, each in zip(config.rest, config.quantities, strict=True)]
        reach = robot.outline if robot.outline is not None else self._reach(robot)
        return {
            "planar": robot.planar,
            "tip_columns": groups.get("tip", []),
            "axis_columns": axes,
            "bends": bends,
            "rest": dict(zip(axes, rest, strict=True)),
            "rates": self._rates(robot, description, groups.get("tip", []), axes, bends),
            "length_mm": robot.length_mm,
            "radius_mm": _radius_mm(description) or robot.length_mm * SLENDERNESS,
            **_counts(description),
            "up": list(robot.up),
            "reach": _line(robot.outline) if robot.outline is not None else [],
            "surface": None if robot.outline is not None else _surface(robot),
            "bounds": _line(self._bounds(robot, reach)),
        }

    @staticmethod
    def _rates(
        robot: RobotScene,
        description: RobotDescription,
        tip: Sequence[str],
        axes: Sequence[str],
        bends: Sequence[Fields],
    ) -> dict[str, float]:
        """How fast every column changes at full speed [1/s]."""
        samples = drawn(robot)[:RATE_SAMPLES]
        found = dict.fromkeys(tip, tip_rate_mm_s(robot, samples))
        found.update(zip(axes, axis_rates(robot), strict=True))
        if bends:
            inside = [_inside(robot, each) for each in samples]
            found.update(
                (each["column"], rate)
                for each, rate in zip(bends, bend_rates(robot, description, inside), strict=True)
            )
        return found

    @staticmethod
    def _reach(robot: RobotScene) -> Array:
        """Tips at random actuations within the limits, (n, 3) [mm]."""
        tips = [tip for each in drawn(robot) if (tip := tip_mm(robot, each)) is not None]
        return np.array(tips or [np.array(robot.config.frame.origin_in_world) * MM_PER_M])

    @staticmethod
    def _bounds(robot: RobotScene, reach: Array) -> Array:
        """The box of the tips that a robot reaches: its lowest and highest corner, (2, 3) [mm].

        Random tips leave out a straight arm, which is the edge of its reach. So the extremes are looked for
        from rest, from the ends of all axes together (a straight arm), and from the farthest random tips.
        """
        model = robot.config.model
        starts = [robot.config.rest, model.lower, model.upper, *drawn(robot)]
        found = [(tip, each) for each in starts if (tip := tip_mm(robot, each)) is not None]
        tips = [*reach, *(tip for tip, _ in found)]
        for coordinate in range(model.dimension):
            for sign in (-1.0, 1.0):
                farthest = np.argsort([-sign * tip[coordinate] for tip, _ in found])[:EXTREME_STARTS]
                tips += [_extreme(robot, found[k][1], coordinate, sign) for k in farthest]
        return np.vstack([np.min(tips, axis=0), np.max(tips, axis=0)])

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
        drawings = {
            robot.config.name: self._drawing(robot, measured.get(robot.config.name))
            for robot in self.scene.robots
        }
        found = {
            name: [] if drawing is None else [_line(strip) for strip in drawing.strips]
            for name, drawing in drawings.items()
        }
        ropes = [line for rope in self.scene.ropes if (line := rope_line(rope, drawings)) is not None]
        ghosts = {
            robot.config.name: ghost
            for robot in self.scene.robots
            if (ghost := self._ghost(robot, drawings[robot.config.name], commanded.get(robot.config.name)))
        }
        return {"robots": found, "ghosts": ghosts, "ropes": [_line(line) for line in ropes]}

    def _ghost(
        self, robot: RobotScene, body: RobotDrawing | None, commanded: Sequence[float] | None
    ) -> list[list[list[float]]]:
        """Lines of the commanded body, none where it is not apart from the measured one."""
        if body is None or commanded is None or None in commanded:
            return []
        actuation = actuation_of(robot, commanded)
        if actuation == body.actuation:
            return []
        try:
            there = robot.drawing(actuation)
        except (ValueError, ArithmeticError):
            return []
        if there is None:
            return []
        pairs = zip(there.strips[: there.sections], body.strips[: body.sections], strict=False)
        apart = max(float(np.abs(a - b).max()) for a, b in pairs if a.shape == b.shape)
        return [_line(strip) for strip in there.strips] if apart > GHOST * robot.length_mm else []

    def _drawing(self, robot: RobotScene, measured: Sequence[float] | None) -> RobotDrawing | None:
        if measured is None:
            return None
        actuation = actuation_of(robot, measured)
        before = self._drawn.get(robot.config.name)
        if before is not None and before[0] == actuation:
            return before[1]
        try:
            drawing = robot.drawing(actuation)
        except (ValueError, ArithmeticError):  # measured outside the domain of the model
            drawing = None
        self._drawn[robot.config.name] = actuation, drawing
        return drawing

    def preflight(self, commands: Mapping[str, Actuation]) -> Preflight:
        """The check of a trajectory from where the robots are."""
        configs = tuple(robot.config for robot in self.scene.robots)
        guards, clearance = chain_guards(self.loaded), self._clearance
        return Preflight(configs, guards, Unreachable.REFUSE, commands, clearance)


def _bends(robot: RobotScene, description: RobotDescription, prefix: str) -> list[Fields]:
    """The columns of the bends of sections, with the range that a slider shows of each.

    A bend of a spatial robot begins at 0, because it has an azimuth beside it.
    """
    model = robot.config.model
    if "arcs" not in description.accepts or not isinstance(model, Bending):
        return []
    inside = [_inside(robot, each) for each in drawn(robot)]
    shapes = [model.arcs(each) for each in (robot.config.rest, *inside)]
    rows = np.array([arc_values(description, shape.tolist()) for shape in shapes])
    found = []
    for column, values in zip(arc_names(description), rows.T, strict=True):
        name, _, unit = column.rpartition("_")
        low, high = float(np.floor(values.min())), float(np.ceil(values.max()))
        if name.endswith("azimuth"):
            low, high = -180.0, 180.0
        elif name.endswith("bend") and description.dimension == 3:
            low = 0.0
        found.append({"column": prefix + column, "name": name, "minimum": low, "maximum": high, "unit": unit})
    return found


def _inside(robot: RobotScene, actuation: Actuation) -> Actuation:
    """The nearest actuation within the limits that couple axes."""
    own = len(robot.config.axes) - robot.config.extra_axes
    return robot.config.model.inverse(Target(actuation=actuation[:own]), actuation).actuation


def actuation_of(robot: RobotScene, values: Sequence[float]) -> Actuation:
    """Values of the axes in their units, as telemetry has them, in m or Pa."""
    return tuple(value / each.per_si for value, each in zip(values, robot.config.quantities, strict=True))


def drawn(robot: RobotScene) -> list[Actuation]:
    """Random actuations within the limits, always the same ones."""
    numbers, model = random.Random(1), robot.config.model
    limits = list(zip(model.lower, model.upper, strict=True))
    return [tuple(numbers.uniform(*each) for each in limits) for _ in range(REACH_TIPS)]


def tip_mm(robot: RobotScene, actuation: Actuation) -> Array | None:
    """The tip in the world frame [mm]; None outside the domain of the model."""
    try:
        tip = robot.config.model.forward(actuation).tip_m
    except (ValueError, ArithmeticError):
        return None
    found: Array = np.array(robot.config.frame.point_in_world(tip)) * MM_PER_M
    return found if np.isfinite(found).all() else None


def _extreme(robot: RobotScene, at: Actuation, coordinate: int, sign: float) -> Array:
    """The farthest tip along a coordinate of the world that is found by moves of one axis after the other."""
    model, best = robot.config.model, tip_mm(robot, at)
    assert best is not None
    for share in EXTREME_STEPS:
        for axis, (low, high) in enumerate(zip(model.lower, model.upper, strict=True)):
            for way in (-share, share):
                moved = min(max(at[axis] + way * (high - low), low), high)
                tried = (*at[:axis], moved, *at[axis + 1 :])
                tip = tip_mm(robot, tried)
                if tip is not None and sign * (tip[coordinate] - best[coordinate]) > 0.0:
                    at, best = tried, tip
    return best


def _surface(robot: RobotScene) -> Fields | None:
    """The reach of a spatial arm as triangles."""
    found = None if robot.planar else reach_surface(robot)
    return found and {"points": _line(found.points), "faces": found.faces.tolist()}


def _counts(description: RobotDescription) -> Fields:
    """How many of the last lines of a body are tendons and, behind them, discs."""
    if not isinstance(description, TendonRobot):
        return {"tendons": 0, "discs": 0, "discs_per_section": 0}
    discs = DISCS * len(description.geometry.sections) + 1
    return {"tendons": len(description.axis_names), "discs": discs, "discs_per_section": DISCS}


def _radius_mm(description: RobotDescription) -> float:
    if isinstance(description, TendonRobot):
        return RIM * max(max(section.radius_mm) for section in description.geometry.sections)
    if isinstance(description, Cosserat):
        return max(section.radius_mm for section in description.geometry.sections)
    if isinstance(description, TriRack):
        return description.geometry.rack_radius_mm
    return 0.0


def _line(points: Array) -> list[list[float]]:
    rounded: list[list[float]] = points.round(DECIMALS).tolist()
    return rounded
