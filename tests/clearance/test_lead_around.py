"""Trajectories of redundant arms past obstacles: led around where the axes can, refused where not."""

import io
import math
from pathlib import Path

import numpy as np
import pytest

from contid import Robot, Sim
from contid.control.engine.wiring import build_preflight, build_robot_configs
from contid.control.tick.preflight.rows import Unreachable
from contid.errors import BadInputError
from contid.kinematics.frames import BaseFrame
from contid.robot_file.base import BasePose
from contid.robot_file.load import parse_robot_file
from contid.targets import Target
from contid.trajectory.read import read_trajectory
from contid_clearance import file_clearance
from contid_clearance.lead import in_base
from contid_clearance.obstacles import Box, Capsule, Plane
from tests.clearance.around import some_obstacles

CONFIGS = Path(__file__).parents[2] / "configs"
CLEARANCE = """
clearance:
  margin_mm: 5
  bodies: {arm: {radius_mm: 40, from_mm: 60}}
  obstacles:
    ball: {sphere: {center_mm: [100, 0, 220], radius_mm: RADIUS}}
"""
#: The bend that is nearest to home touches the ball on the way to the second row.
ROWS = "t_s,x_mm,y_mm,z_mm\n0,0,0,450\n6,150,0,450\n"


def text(radius_mm):
    return (CONFIGS / "trirack2.yaml").read_text() + CLEARANCE.replace("RADIUS", str(radius_mm))


def check(radius_mm):
    loaded = parse_robot_file(text(radius_mm), "ball.yaml")
    preflight = build_preflight(loaded, 100.0, Unreachable.REFUSE)
    assert preflight is not None
    preflight.trajectory(read_trajectory(io.StringIO(ROWS), "a.csv", loaded.driven), "a.csv")


@pytest.mark.slow
def test_a_trajectory_that_would_touch_is_led_around_by_the_free_axes(monkeypatch):
    check(30)
    monkeypatch.setattr(file_clearance, "lead_around", lambda *_: None)
    with pytest.raises(BadInputError, match=r"arm at \d+ mm of its length comes within 4\.\d+ mm of ball"):
        check(30)


def test_an_obstacle_without_a_way_around_is_refused_as_before():
    with pytest.raises(BadInputError, match=r"ball; clearance\.margin_mm is 5"):
        check(65)


@pytest.mark.slow
def test_every_tick_keeps_the_margin_with_the_tip_on_its_line(tmp_path):
    """The backbone by the library and the distance by its points: another way than the tick's."""
    file = tmp_path / "ball.yaml"
    # At rest it is near the first tip: on the way there every tick looks at its stop.
    file.write_text(
        text(30).replace("rest_mm: [10, 10, 10, 10, 10, 10]", "rest_mm: [190, 190, 190, 190, 190, 190]")
    )
    robot = Robot("trirack2")
    with Sim(str(file)) as sim:
        state = sim.step({"x_mm": 0.0, "y_mm": 0.0, "z_mm": 450.0}, ticks=500)["arm"]
        assert np.array(state.tip) == pytest.approx([0, 0, 450], abs=0.01)
        apart, off, late = [], [], []
        for k in range(1, 801):
            x = 150 * k / 800
            state = sim.step({"x_mm": x, "y_mm": 0.0, "z_mm": 450.0})["arm"]
            assert state.refused == ""
            if k % 4:
                continue
            points = robot.backbone(state.command, 400)
            points = points[np.linspace(0, 1, 400) * 450 > 90]  # past from_mm, whatever the length
            apart.append(np.linalg.norm(points - [100, 0, 220], axis=1).min() - 40 - 30)
            off.append(math.dist(points[-1][1:], [0, 450]))
            late.append(x - points[-1][0])
        assert min(apart) >= 5 - 0.05
        assert min(apart) < 25
        assert -0.01 < min(late) < max(late) < 150 / 800 * 6  # while the clock of the rows is learnt
        assert max(late[50:]) < 0.7  # a live row is followed 2 rows later
        assert max(off) < 1e-2  # while the axes join the moving target
        assert max(off[25:]) < 1e-3


@pytest.mark.parametrize("mirror", [False, True])
def test_an_obstacle_in_the_frame_of_a_base_has_the_same_distances(mirror):
    pose = BasePose(x_mm=30, y_mm=-20, z_mm=100, roll_deg=20, pitch_deg=-40, yaw_deg=70, mirror_x=mirror)
    frame, rng = BaseFrame.of(pose), np.random.default_rng(0)
    kinds = set()
    for each in some_obstacles(rng, 12):
        kinds.add(type(each))
        points = rng.uniform(-0.5, 0.8, (20, 3))
        moved = np.array([frame.point_in_base(tuple(p)) for p in points])
        assert in_base(frame, each).signed_distance(moved) == pytest.approx(
            each.signed_distance(points), abs=1e-12
        )
    assert kinds == {Plane, Capsule, Box}


def test_tendon_robots_bend_around_a_ball_beside_their_body():
    """Their base offset, and an axis beyond the kinematics, are between the file and the solver."""
    head, tail = (CONFIGS / "tendon3.yaml").read_text().split("    rest_mm:", 1)
    grip = "      grip: {bus: servos, id: 40, mm_per_rev: 40}\n"
    source = f"{head}    extra_mm: {{grip: [0, 30]}}\n    rest_mm:{tail}".replace(
        "    axes:\n", "    axes:\n" + grip
    )
    met = touching = 0
    for angle in np.linspace(0.0, 2 * np.pi, 6, endpoint=False):
        tip = (0.1 * math.cos(angle), 0.1 * math.sin(angle), 0.26)
        (before,) = build_robot_configs(parse_robot_file(source, "t.yaml"), 100.0)
        plain = before.model.inverse(Target(tip_m=tip), before.rest)
        body = before.model.shape(plain.actuation, 301)
        aside = np.array([-math.sin(angle), math.cos(angle), 0.0])
        center = body[150] + 0.016 * aside
        ball = f"ball: {{sphere: {{center_mm: {(1e3 * center).round(6).tolist()}, radius_mm: 8}}}}"
        clearance = (
            f"clearance:\n  margin_mm: 2\n  bodies: {{arm: {{radius_mm: 8}}}}\n  obstacles:\n    {ball}\n"
        )
        (config,) = build_robot_configs(parse_robot_file(source + "\n" + clearance, "t.yaml"), 100.0)
        found = config.model.inverse(Target(tip_m=tip), config.rest)
        touching += np.linalg.norm(body - center, axis=1).min() - 0.016 < 0.002
        around = config.model.shape(found.actuation, 301)
        clear = np.linalg.norm(around - center, axis=1).min() - 0.016 >= 0.002
        met += found.converged and clear and math.dist(around[-1], tip) < 1e-6
    assert touching == 6
    assert met == 6
