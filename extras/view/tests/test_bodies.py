"""Drawn bodies, measured against dimensions of the robot file and against another formulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contid.control.engine.events.robots import FaultLatched, ModeChanged
from contid.robot_file.load import load_named
from contid.robot_file.sections import SectionRobot
from contid_view.banner import Banner
from contid_view.body import Cylinders, SolidBody, between
from contid_view.body_plan import PIECES, body_plan
from contid_view.robot_scene import RobotScene
from contid_view.scene import build_scene
from contid_view.transport import transported

ROBOTS = ("finger", "trirack", "trirack2", "cbha", "stiffflop1", "stiffflop2", "tendon3")


def scene_of(name: str) -> tuple[RobotScene, SolidBody]:
    scene = build_scene(load_named(name), 100.0)
    return scene.robots[0], scene.bodies[0]


def placed(name: str, *shares: float) -> tuple[RobotScene, SolidBody, Cylinders, tuple[float, ...]]:
    """The body where every axis is at a share of its range; extra shares are repeated."""
    robot, body = scene_of(name)
    model = robot.config.model
    at = np.resize(np.array(shares), len(model.lower))
    actuation = tuple((np.array(model.lower) + at * (np.array(model.upper) - np.array(model.lower))).tolist())
    drawing = robot.drawing(actuation)
    assert drawing is not None
    return robot, body, body.place([drawing, drawing]), actuation


@pytest.mark.parametrize("name", ROBOTS)
def test_a_body_ends_at_the_tip_and_begins_at_the_base(name: str) -> None:
    robot, _, cylinders, actuation = placed(name, 0.3, 0.6, 0.5)
    drawing = robot.drawing(actuation)
    assert drawing is not None
    half = cylinders.lengths[0, :, None] / 2.0
    axes = Rotation.from_quat(cylinders.quaternions[0]).apply([0.0, 0.0, 1.0])
    middles = cylinders.centres[0]
    ends = np.concatenate([middles - half * axes, middles + half * axes, middles])
    for place in (drawing.tip, robot.base[0]):
        assert np.min(np.linalg.norm(ends - place, axis=1)) < 1e-6
    # No part is farther from the backbone than the outermost dimension of the robot.
    line = np.vstack(drawing.strips[: drawing.sections])
    off = np.linalg.norm(cylinders.centres[0][:, None] - line, axis=2).min(axis=1)
    assert off.max() < 0.35 * robot.length_mm
    assert np.isfinite(cylinders.centres).all()


@pytest.mark.parametrize("name", ["trirack2", "cbha"])
def test_racks_and_tubes_are_as_long_as_their_axes(name: str) -> None:
    """The plan puts them at the radius of the file; their lengths there are the commanded ones."""
    robot, _, cylinders, actuation = placed(name, 0.35, 0.5, 0.45, 0.5, 0.4, 0.6)
    description = load_named(name).file.robots[robot.config.name]
    assert isinstance(description, SectionRobot)
    parts = body_plan(description, robot.length_mm)
    for axis in range(6):
        section, tube = divmod(axis, 3)
        angle = np.radians(description.tube_angles_deg[section][tube])
        across = 1e3 * description.radius_m[section] * np.array([np.cos(angle), np.sin(angle)])
        mine = [
            k
            for k, part in enumerate(parts)
            if section <= part.begin < part.end <= section + 1
            and np.allclose(part.from_mm[:2], across)
            and part.end - part.begin > 0.1
        ]
        assert len(mine) in (PIECES, PIECES // 2, 7, 7 + PIECES // 2)
        span = cylinders.centres[0][mine]
        whole = [k for k in mine if parts[k].shade == parts[mine[0]].shade]
        lapped = sum(cylinders.lengths[0, k] - (parts[k].to_mm[2] - parts[k].from_mm[2]) for k in whole)
        share = sum(parts[k].end - parts[k].begin for k in whole)
        rigid = 1e3 * description.rigid_m[section]
        # A rigid piece after the section is part of the drawn tube.
        assert lapped / share == pytest.approx(1e3 * actuation[axis] + rigid, rel=0.02)
        assert np.linalg.norm(np.diff(span, axis=0), axis=1).max() < 1e3 * actuation[axis]


@pytest.mark.parametrize("name", ["tendon3", "bend1", "ftdcr_v4"])
def test_discs_of_a_tendon_robot_are_where_its_tendons_are_led(name: str) -> None:
    """Pieces before the first section and behind the last one have none: of bend1 10 and 5 of 135 mm."""
    robot, body = scene_of(name)
    drawing = robot.drawing(robot.config.rest)
    assert drawing is not None
    # Straight up; lines of discs have their corners and the first one again.
    discs = {round(float(line[0, 2]), 3) for line in drawing.strips[drawing.sections :] if len(line) > 20}
    cylinders = body.place([drawing])
    plates = body.shades == 2
    tops = (cylinders.centres[0, :, 2] + 0.5 * cylinders.lengths[0])[plates]
    assert {round(float(each), 3) for each in tops} == discs


def test_transport_agrees_with_the_frame_of_the_model_on_an_arc() -> None:
    """An arc in a plane that is turned about z: its end frame is one rotation about the normal."""
    for azimuth, bend in ((0.3, 1.2), (-2.0, 2.8), (1.0, 0.0)):
        turn = Rotation.from_euler("z", azimuth)
        s = np.linspace(0.0, 1.0, 400)
        flat = np.stack(
            [(1 - np.cos(bend * s)) / max(bend, 1e-9), 0 * s, np.sinc(bend * s / np.pi) * s], axis=1
        )
        line = turn.apply(flat)[None]
        x, y, z = (axis[0, -1] for axis in transported(line, np.array([1.0, 0, 0]), np.array([0, 0, 1.0])))
        expected = (turn * Rotation.from_euler("y", bend) * turn.inv()).as_matrix()
        assert np.allclose(np.column_stack([x, y, z]), expected, atol=4e-3)


def test_a_cylinder_lies_between_its_points_also_upside_down() -> None:
    random = np.random.default_rng(1)
    begin, way = random.normal(size=(1, 50, 3)), random.normal(size=(1, 50, 3))
    way[0, :3] = [[0, 0, 2.0], [0, 0, -2.0], [1e-13, 0, -2.0]]
    cylinders = between(begin, begin + way)
    turned = Rotation.from_quat(cylinders.quaternions[0]).apply([0.0, 0.0, 1.0])
    assert np.allclose(turned * cylinders.lengths[0, :, None], way[0], atol=1e-9)
    assert np.allclose(cylinders.centres, begin + way / 2.0)


def test_the_banner_has_modes_and_a_fault_with_its_remedy_until_it_is_cleared() -> None:
    banner = Banner(["left", "right"])
    assert banner.changed(ModeChanged(robot="left", mode="RUN", tick=1))
    assert banner.text() == "left **RUN** · right **OFF**"
    fault = FaultLatched(
        robot="left", fault=102, name="axis-silent", message="m", detail="left.left is silent", tick=2
    )
    assert banner.changed(fault)
    assert banner.text().startswith("# FAULT 102 · left: left.left is silent\n\nRemedy: check that device")
    assert not banner.changed(ModeChanged(robot="left", mode="FAULT", tick=2))
    assert banner.changed(ModeChanged(robot="left", mode="HOLD", tick=9))
    assert banner.text() == "left **HOLD** · right **OFF**"


def test_the_banner_shows_a_fault_of_a_later_version_without_a_remedy() -> None:
    banner = Banner(["left"])
    assert banner.changed(FaultLatched(robot="left", fault=399, name="new", message="it is new", tick=2))
    assert banner.text() == "# FAULT 399 · left: it is new"
