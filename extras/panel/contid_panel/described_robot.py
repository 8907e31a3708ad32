"""What does not change about one robot: its columns with their ranges and rates, its sizes, its reach."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.model import Bending
from contid.remote.protocol.wire import Fields
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tendon.robot import TendonRobot
from contid.robot_file.tri_rack import TriRack
from contid.targets import Actuation
from contid.trajectory.arc_columns import arc_names, arc_values
from contid.trajectory.columns import column_groups
from contid.units import MM_PER_M
from contid_panel.rates import bend_rates, tip_rate_mm_s
from contid_panel.reach_surface import reach_surface
from contid_panel.samples import drawn, inside, rounded_line, tip_mm, values_of
from contid_view.body_plan import SLENDERNESS
from contid_view.robot_scene import RobotScene
from contid_view.tendon_lines import DISCS, RIM

#: How many random actuations show the rates of columns.
RATE_SAMPLES: Final = 20
#: Steps of the search for an extreme tip, as shares of the range of an axis.
EXTREME_STEPS: Final = (1.0, 0.5, 0.25, 0.1, 0.1, 0.03)
#: Actuations from which it begins.
EXTREME_STARTS: Final = 5


def described_robot(robot: RobotScene, description: RobotDescription, several: bool) -> Fields:
    """Columns, sizes and reach of one robot; of ``several`` the columns have its name in front."""
    config = robot.config
    prefix = f"{config.name}." if several else ""
    tip = column_groups(prefix, description).get("tip", [])
    axes = [f"{prefix}{each}" for each in description.columns]
    bends = _bends(robot, description, prefix)
    return {
        "planar": robot.planar,
        "tip_columns": tip,
        "axis_columns": axes,
        "bends": bends,
        "rest": dict(zip(axes, values_of(config, config.rest), strict=True)),
        "rates": _rates(robot, description, tip, axes, bends),
        "length_mm": robot.length_mm,
        "radius_mm": _radius_mm(description) or robot.length_mm * SLENDERNESS,
        **_counts(description),
        "swings": swings(description),
        "up": list(robot.up),
        "reach": rounded_line(robot.outline) if robot.outline is not None else [],
        "surface": None if robot.outline is not None else _surface(robot),
        "bounds": rounded_line(_bounds(robot)),
    }


def swings(description: RobotDescription) -> bool:
    """The robot has a body that moves: its file has ``dynamics``."""
    return getattr(description, "dynamics", None) is not None


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
    found.update(zip(axes, values_of(robot.config, robot.config.velocity), strict=True))
    if bends:
        rates = bend_rates(robot, description, [inside(robot.config, each) for each in samples])
        found.update((each["column"], rate) for each, rate in zip(bends, rates, strict=True))
    return found


def _bounds(robot: RobotScene) -> Array:
    """The box of the tips that a robot reaches: its lowest and highest corner, (2, 3) [mm].

    Random tips leave out a straight arm, which is the edge of its reach. So the extremes are looked for
    from rest, from the ends of all axes together (a straight arm), and from the farthest random tips.
    """
    model = robot.config.model
    starts = [robot.config.rest, model.lower, model.upper, *drawn(robot)]
    found = [(tip, each) for each in starts if (tip := tip_mm(robot, each)) is not None]
    tips = [*(() if robot.outline is None else robot.outline), *(tip for tip, _ in found)]
    for coordinate in range(model.dimension):
        for sign in (-1.0, 1.0):
            farthest = np.argsort([-sign * tip[coordinate] for tip, _ in found])[:EXTREME_STARTS]
            tips += [_extreme(robot, found[k][1], coordinate, sign) for k in farthest]
    tips = tips or [np.array(robot.config.frame.origin_in_world) * MM_PER_M]
    return np.vstack([np.min(tips, axis=0), np.max(tips, axis=0)])


def _bends(robot: RobotScene, description: RobotDescription, prefix: str) -> list[Fields]:
    """The columns of the bends of sections, with the range that a slider shows of each.

    A bend of a spatial robot begins at 0, because it has an azimuth beside it.
    """
    model = robot.config.model
    if "arcs" not in description.accepts or not isinstance(model, Bending):
        return []
    reached = [inside(robot.config, each) for each in drawn(robot)]
    shapes = [model.arcs(each) for each in (robot.config.rest, *reached)]
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
    return found and {"points": rounded_line(found.points), "faces": found.faces.tolist()}


def _counts(description: RobotDescription) -> Fields:
    """How many of the last lines of a body are tendons and, behind them, discs."""
    if not isinstance(description, TendonRobot):
        return {"tendons": 0, "discs": 0, "discs_per_section": 0}
    sections = description.geometry.sections
    tendons = sum(len(section.angles_deg) for section in sections)  # with ``drives`` an axis pulls several
    return {"tendons": tendons, "discs": DISCS * len(sections) + 1, "discs_per_section": DISCS}


def _radius_mm(description: RobotDescription) -> float:
    if isinstance(description, TendonRobot):
        return RIM * max(max(section.radius_mm) for section in description.geometry.sections)
    if isinstance(description, Cosserat):
        return max(section.radius_mm for section in description.geometry.sections)
    if isinstance(description, TriRack):
        return description.geometry.rack_radius_mm
    return 0.0
