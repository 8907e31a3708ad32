"""x and y alone as targets of arms of one section, against products of matrix exponentials."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.errors import BadInputError
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Bending, build_model
from contid.robot_file.load import load_named
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tendon.robot import TendonRobot
from contid.trajectory.columns import RobotColumns
from contid.trajectory.rows import RowReader
from contid.trajectory.surface_columns import SurfaceColumns
from tests.oracles.twists import Chain

BASES: tuple[dict[str, float], ...] = (
    {},
    {"x_mm": 30.0, "y_mm": -20.0, "z_mm": 400.0, "yaw_deg": 35.0},
    {"z_mm": 500.0, "roll_deg": 180.0, "yaw_deg": -70.0},
)


def robot_of(name: str, base: dict[str, float]) -> TendonRobot:
    robot = next(iter(load_named(name).file.robots.values()))
    assert isinstance(robot, TendonRobot)
    return robot.model_copy(update={"base": robot.base.model_copy(update=base)})


def reader(robot: RobotDescription, header: str = "x_mm,y_mm") -> RowReader:
    return RowReader(header, "targets.csv", {"arm": robot})


def oracle_tip(robot: TendonRobot, u: float, v: float) -> np.ndarray:
    """In the world [m]."""
    (section,) = robot.geometry.sections
    rigid_m = section.rigid_mm / 1e3
    arc = np.array([[u, v, section.length_mm / 1e3]])
    end = Chain(lambda _: arc, (rigid_m,)).placed(np.zeros(1))
    tip = end.tip + end.rotation @ np.array(robot.geometry.tip_offset_mm) / 1e3
    tip = tip + np.array([0.0, 0.0, robot.geometry.base_offset_mm / 1e3])
    return np.array(BaseFrame.of(robot.base).point_in_world(tuple(tip.tolist())))


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("name", ["catheter", "bend1"])
def test_the_tip_has_x_and_y(name: str, base: dict[str, float]) -> None:
    robot, rng = robot_of(name, base), np.random.default_rng(3)
    rows, model = reader(robot), build_model(robot)
    assert isinstance(model, Bending)
    for distance_mm in (0.0, 1e-6, 0.1, 5.0, 20.0, 45.0):
        azimuth = rng.uniform(-math.pi, math.pi)
        x, y = (
            distance_mm * math.cos(azimuth) + robot.base.x_mm,
            distance_mm * math.sin(azimuth) + robot.base.y_mm,
        )
        target = rows.layout.targets(rows.row([x, y], 2))["arm"]
        assert target.tip_m is None
        assert target.arcs is not None
        u, v, _ = target.arcs
        assert 1e3 * oracle_tip(robot, u, v)[:2] == pytest.approx([x, y], abs=1e-7)
        tip = model.forward(model.of_arcs(target.arcs, robot.rest)).tip_m
        assert 1e3 * np.array(BaseFrame.of(robot.base).point_in_world(tip))[:2] == pytest.approx(
            [x, y], abs=1e-6
        )


def test_rows_come_back() -> None:
    robot = robot_of("catheter", BASES[1])
    rows = reader(robot)
    (columns,) = rows.layout.robots
    assert isinstance(columns, RobotColumns)
    (surface,) = columns.arcs
    assert isinstance(surface, SurfaceColumns)
    row = rows.row([42.0, -3.5], 2)
    surface.restore(row)
    assert 1e3 * np.array(row) == pytest.approx([42.0, -3.5], abs=1e-9)


def test_beside_the_surface_is_refused_with_its_place() -> None:
    with pytest.raises(
        BadInputError, match=r"targets.csv:7:1: the tip is 90 mm beside the axis.* farther than"
    ):
        reader(robot_of("catheter", {})).row("90,0", 7)


@pytest.mark.parametrize(
    ("name", "base"), [("catheter", {"roll_deg": 90.0}), ("tendon3", {}), ("chambers3", {})]
)
def test_other_robots_need_z(name: str, base: dict[str, float]) -> None:
    robot = next(iter(load_named(name).file.robots.values()))
    robot = robot.model_copy(update={"base": robot.base.model_copy(update=base)})
    with pytest.raises(BadInputError, match="'x_mm' needs 'z_mm' beside it"):
        reader(robot)
