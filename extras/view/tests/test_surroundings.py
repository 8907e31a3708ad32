"""Obstacles and the compliance of a tip in the viewer: where they are, rotations against scipy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contid.robot_file.clearance import PlaneDescription
from contid.robot_file.load import load_robot_file, parse_robot_file
from contid_view.body import quaternion_of
from contid_view.scene import PLANE_CELLS, build_scene, plane_grid
from contid_view.shapes.compliance import scale_force_n
from contid_view.shapes.load_arrow import mm_per_newton
from tests.support.command import contid
from tests.support.rerun_entities import entities

pytestmark = pytest.mark.process

OBSTACLES = """
clearance:
  bodies:
    arm: {radius_mm: 12}
  obstacles:
    table: {plane: {point_mm: [0, 0, -200], normal: [0, 0, 1]}}
    ball: {sphere: {center_mm: [200, 0, 60], radius_mm: 20}}
    post: {capsule: {start_mm: [-200, 0, 0], end_mm: [-200, 0, 100], radius_mm: 8}}
    crate: {box: {center_mm: [0, 250, 40], size_mm: [40, 30, 20], yaw_deg: 30}}
"""


def test_quaternions_are_those_of_scipy() -> None:
    turns = [*Rotation.random(200, random_state=5).as_matrix(), *np.diag([1.0, -1.0, -1.0])[None], np.eye(3)]
    for matrix in turns:
        assert Rotation.from_quat(quaternion_of(np.array(matrix))).as_matrix() == pytest.approx(
            matrix, abs=1e-12
        )


def test_a_reading_without_an_equilibrium_is_not_drawn(configs: Path) -> None:
    """A servo that reports a metre of tendon: the run has a fault, and its drawing goes on."""
    text = (configs / "tendon3.yaml").read_text().replace("    rates:\n", "    rod: {}\n    rates:\n", 1)
    (robot,) = build_scene(parse_robot_file(text, "rod.yaml"), 200.0).robots
    rest = robot.config.rest
    assert robot.drawing(rest) is not None
    assert robot.drawing((rest[0] + 1.0, *rest[1:])) is None


@pytest.mark.parametrize("normal", [(0.0, 0.0, 2.0), (1.0, -2.0, 0.5)])
def test_the_grid_of_a_plane_is_on_it_and_beside_the_workspace(normal: tuple[float, float, float]) -> None:
    workspace = np.random.default_rng(1).uniform(-100.0, 100.0, (50, 3))
    plane = PlaneDescription(point_mm=(10.0, 20.0, -300.0), normal=normal)
    lines = plane_grid(plane, workspace)
    assert len(lines) == 2 * (PLANE_CELLS + 1)
    away = (np.vstack(lines) - plane.point_mm) @ normal / np.linalg.norm(normal)
    assert np.abs(away).max() < 1e-9
    middle = 0.5 * (workspace.min(axis=0) + workspace.max(axis=0))
    off = np.vstack(lines).mean(axis=0) - middle
    assert np.linalg.norm(np.cross(off, normal)) < 1e-9 * np.linalg.norm(normal) * 1e3


@pytest.mark.parametrize(
    ("softest", "length", "force"), [(4000.0, 100.0, 0.002), (10.0, 100.0, 1.0), (0.6, 300.0, 50.0)]
)
def test_the_force_of_the_ellipsoid_is_a_round_number(softest: float, length: float, force: float) -> None:
    assert scale_force_n(softest, length) == pytest.approx(force)
    assert 0.04 * length < scale_force_n(softest, length) * softest <= 0.1 * length * (1.0 + 1e-9)


@pytest.mark.process
def test_obstacles_and_the_ellipsoid_are_in_the_recording_of_a_run(tmp_path: Path, configs: Path) -> None:
    robot, drawing = tmp_path / "arm.yaml", tmp_path / "run.rrd"
    robot.write_text((configs / "stiffflop2.yaml").read_text() + OBSTACLES)
    rows = "x_mm,y_mm,z_mm\n20,10,100\n"
    done = contid("run", str(robot), "--virtual", "--view", str(drawing), stdin=rows)
    assert done.returncode == 0, done.stderr
    there = entities(drawing)
    assert {f"obstacles/{name}" for name in ("table", "ball", "post", "crate")} <= set(there)
    assert there["robots/arm/compliance"] >= 5
    loaded = load_robot_file(robot)
    assert set(build_scene(loaded, loaded.file.rate_hz).obstacles) == {"table", "ball", "post", "crate"}


@pytest.mark.process
def test_the_estimated_load_is_an_arrow_in_the_recording_of_a_run(tmp_path: Path, configs: Path) -> None:
    zeros = ", ".join(["0"] * 6)
    factor = "".join(f"          - [{', '.join(['0'] * row + ['0.001'])}]\n" for row in range(22))
    sense = (
        "    sim: {payload_g: 5}\n    sense:\n      load:\n        calibration:\n"
        + "".join(f"          {key}: [{zeros}]\n" for key in ("offset_bar", "gain", "loop_bar"))
        + "          modulus: [0, 0]\n          moment: [0, 0]\n"
        + "          axis_sigma_bar: 0.001\n          tip_sigma_mm: 0.1\n          covariance_factor:\n"
        + factor.replace("          - ", "            - ")
    )
    text = (configs / "stiffflop2.yaml").read_text()
    robot, drawing = tmp_path / "arm.yaml", tmp_path / "run.rrd"
    robot.write_text(text.replace("    stop: {on_end", sense + "    stop: {on_end", 1))
    rows = "t_s,x_mm,y_mm,z_mm\n0,20,10,100\n1,20,10,100\n"
    done = contid("run", str(robot), "--virtual", "--view", str(drawing), stdin=rows)
    assert done.returncode == 0, done.stderr
    assert entities(drawing)["robots/arm/load"] >= 5


def test_the_arrow_of_the_expected_load_is_half_the_arm() -> None:
    assert mm_per_newton(20.0, 90.0) * 0.020 * 9.80665 == pytest.approx(45.0)
