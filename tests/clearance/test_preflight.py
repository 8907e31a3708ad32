"""Clearance of robot files: refused trajectories, approaches and moves, by row with the distance."""

import io
from functools import partial

import numpy as np
import pytest

from contid import Sim
from contid.control.engine.wiring import build_preflight
from contid.control.tick.preflight.rows import Unreachable
from contid.errors import BadInputError, ContidError
from contid.kinematics.model import build_model
from contid.robot_file.load import load_named, parse_robot_file
from contid.targets import ZERO3
from contid.trajectory.read import read_trajectory
from contid_clearance.body import sampled_body
from contid_clearance.file_clearance import clearance_guard
from contid_clearance.guard import Shapes
from contid_clearance.walk import RESOLUTION_M, Walk
from tests.clearance.finger_file import FINGER, WALL
from tests.support.command import contid


def finger(obstacle):
    return parse_robot_file(FINGER.replace("OBSTACLE", obstacle), "post.yaml")


def guard_of(loaded):
    guard = clearance_guard(loaded)
    assert guard is not None
    return guard


def preflight_of(loaded):
    preflight = build_preflight(loaded, 100.0, Unreachable.REFUSE)
    assert preflight is not None
    return preflight


def trajectory(*rows):
    return "t_s,left_mm,right_mm\n" + "".join(f"{','.join(map(str, row))}\n" for row in rows)


@pytest.mark.process
def test_the_shipped_hand_runs_its_circle_and_refuses_crossed_fingers():
    circle = contid("path", "circle", "--center=50,70", "--radius=20", "--period=4", "--for=hand").stdout
    assert contid("check", "hand", "-", stdin=circle).returncode == 0
    crossed = "t_s,left.x_mm,left.y_mm,right.x_mm,right.y_mm\n0,20,80,80,80\n2,65,70,35,70\n"
    refused = contid("check", "hand", "-", stdin=crossed)
    assert refused.returncode == 2
    assert "stdin:3:1: on the way to this row, before it can stop, left at" in refused.stderr
    assert "into the tip of right; clearance.tip_depth_mm is 0.5" in refused.stderr


def test_a_wall_is_refused_at_its_row_with_the_distance():
    file = finger(WALL)
    robots = file.driven
    good = trajectory((0, 60, 60), (3, 58, 62))
    preflight_of(file).trajectory(read_trajectory(io.StringIO(good), "a.csv", robots), "a.csv")
    text = trajectory((0, 60, 60), (3, 58, 62), (6, 50, 70))
    bad = read_trajectory(io.StringIO(text), "b.csv", robots)
    with pytest.raises(BadInputError) as error:
        preflight_of(file).trajectory(bad, "b.csv")
    found = error.value.findings
    assert [each.line for each in found] == [4]
    assert "of wall; clearance.margin_mm is 1" in found[0].message


def test_an_approach_that_sweeps_over_a_post_is_refused_where_its_ends_are_clear():
    """Only the ends of the approach are rows; both are clear of a ball beside the way of the tip."""
    ball = "ball: {sphere: {center_mm: [48, 58, 0], radius_mm: 3}}"
    guard = guard_of(finger(ball))
    ends = {"rest": (0.060, 0.060), "bent": (0.035, 0.085)}
    for name, actuation in ends.items():
        found = Shapes(guard, {"f": (actuation, ZERO3)}).nearest(("f", "ball"))
        assert found.distance.lower_m > guard.margin_m, name
    walk = Walk(guard, {"f": (ends["rest"], ZERO3)})
    message = walk.to({"f": (ends["bent"], ZERO3)})  # in one step: nothing between is given
    assert "ball; clearance.margin_mm is 1" in message
    assert walk.configuration["f"][0] == ends["rest"]


def test_no_way_is_accepted_that_dense_sampling_finds_too_near():
    guard = guard_of(finger("ball: {sphere: {center_mm: [45, 60, 0], radius_mm: 8}}"))
    rng = np.random.default_rng(1)
    walk = Walk(guard, {"f": ((0.060, 0.060), ZERO3)})
    accepted = refused = 0
    for _ in range(24):
        before = walk.configuration["f"][0]
        middle = rng.uniform(0.03, 0.08)
        goal = tuple(np.clip([middle + (bend := rng.uniform(-0.02, 0.02)), middle - bend], 0.0, 0.1).tolist())
        message = walk.to({"f": (goal, ZERO3)})
        least = min(
            Shapes(guard, {"f": (tuple(np.array(before) * (1 - u) + np.array(goal) * u), ZERO3)})
            .nearest(("f", "ball"))
            .distance.upper_m
            for u in np.linspace(0, 1, 61)
        )
        if message:
            refused += 1
            assert least < guard.margin_m + 5e-3  # between 61 samples
        else:
            accepted += 1
            assert least >= guard.margin_m - RESOLUTION_M
    assert accepted > 3
    assert refused > 3


def test_a_move_of_the_simulated_hand_holds_at_a_refusal():
    with Sim("hand") as sim:
        sim.step({"left.x_mm": 20.0, "left.y_mm": 80.0, "right.x_mm": 80.0, "right.y_mm": 80.0}, ticks=200)
        state = sim.step(
            {"left.x_mm": 68.0, "left.y_mm": 70.0, "right.x_mm": 32.0, "right.y_mm": 70.0}, ticks=100
        )
        assert "the tip of right; clearance.tip_depth_mm is 0.5" in state["left"].refused
        assert state["left"].mode == "HOLD"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("bodies: {f: {radius_mm: 7}}", "bodies: {g: {radius_mm: 7}}", "'g' is no robot of this file"),
        ("{radius_mm: 7}", "{radius_m: 7}", "unknown key 'radius_m'"),
        ("margin_mm: 1", "margin_mm: 0", "margin_mm: allowed is a number at least 0.5"),
        ("normal: [-1, 0, 0]", "normal: [0, 0, 0]", "must not be the zero vector"),
        ("wall: {plane:", "f: {plane:", "'f' is the name of a robot"),
        ("wall: {plane:", "wall: {plain:", "unknown key 'plain'"),
        ("margin_mm: 1", "margin_mm: 1\n  ignore: [[f, wal]]", "did you mean 'wall'"),
        ("wall: {plane: {point_mm: [40, 0, 0], normal: [-1, 0, 0]}}", "wall: {}", "written: none"),
    ],
)
def test_mistakes_in_the_file_have_their_place(old, new, expected):
    text = FINGER.replace("OBSTACLE", WALL)
    assert old in text
    with pytest.raises(BadInputError) as error:
        parse_robot_file(text.replace(old, new), "post.yaml")
    assert any(expected in each.message and each.line > 15 for each in error.value.findings), str(error.value)


def test_a_rest_pose_inside_an_obstacle_is_refused():
    with pytest.raises(ContidError, match=r"at the rest pose, f at .* of its length runs into post"):
        clearance_guard(finger("post: {sphere: {center_mm: [0, 50, 0], radius_mm: 5}}"))


def test_nearest_points_are_refused_together_with_clearance():
    with pytest.raises(ContidError, match="not checked for clearance"):
        build_preflight(finger(WALL), 100.0, Unreachable.NEAREST)


def test_a_pair_that_is_ignored_is_not_checked():
    text = FINGER.replace("OBSTACLE", WALL).replace("margin_mm: 1", "margin_mm: 1\n  ignore: [[f, wall]]")
    guard = guard_of(parse_robot_file(text, "a"))
    assert guard.pairs == ()
    assert guard.sampled == (("f", "f"),)
    text = text.replace("[[f, wall]]", "[[f, wall], [f, f]]")
    assert guard_of(parse_robot_file(text, "a")).sampled == ()


def test_bodies_of_every_shipped_robot_bound_their_backbones():
    """Points of a backbone at other stations lie inside the body that 32 or more pieces give."""
    for name in ("finger", "trirack2", "stiffflop2", "tendon3", "cbha"):
        robot = next(iter(load_named(name).file.robots.values()))
        model = build_model(robot)
        actuation = tuple((0.3 * np.array(model.lower) + 0.7 * np.array(model.upper)).tolist())
        body = sampled_body(partial(model.shape, actuation), 0.0)
        between = model.shape(actuation, 7 * body.pieces + 1)
        chord = body.points[1:] - body.points[:-1]
        # The ellipse of the points whose distances to both ends of a piece sum up to its length.
        short = np.maximum(body.spacing_m**2 - np.sum(chord**2, axis=1), 0.0)
        allowance = 0.5 * np.sqrt(short)
        assert body.off_pieces_m() == pytest.approx(allowance.max(), rel=1e-6)
        for k in range(body.pieces):
            inside = between[7 * k + 1 : 7 * k + 7] - body.points[k]
            unit = chord[k] / np.linalg.norm(chord[k])
            off = np.linalg.norm(inside - np.outer(inside @ unit, unit), axis=1)
            assert off.max() <= allowance[k] + 1e-7, (name, k)
