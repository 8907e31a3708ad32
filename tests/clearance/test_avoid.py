"""Redundant axes keep the body away from obstacles: clear answers, continuous, unchanged where it is free."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contid.kinematics.arc.section_model import build_solver
from contid.kinematics.arc.solver import tuning_for
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.load import load_named
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Target
from contid_clearance.obstacles import Box, Capsule, Plane
from tests.clearance.around import (
    FROM_M,
    MARGIN_M,
    RADIUS_M,
    avoiding,
    gap_m,
    posture,
    potential,
    racks,
    some_obstacles,
    zone_and_force,
)
from tests.kernels.arc_cases import metric
from tests.oracles import section_limits, twists

ARMS = pytest.mark.parametrize("sections", [2, pytest.param(3, marks=pytest.mark.campaign)])


def tip_of(solver, lengths):
    return solver.forward(tuple(lengths.tolist()))[0]


def cases(sections, count, seed=0):
    """Targets with obstacles the plain answer touches, and the answers of both."""
    rng, feasible = np.random.default_rng(seed), racks(sections)
    plain, kept = build_solver(feasible), build_solver(feasible)
    home = tuple(feasible.home.tolist())
    while count:
        target, obstacles = tip_of(plain, posture(feasible, rng)), some_obstacles(rng)
        if target[2] < 0.2 or min(each.signed_distance(np.array([target]))[0] for each in obstacles) < 0.06:
            continue
        before = plain.solve(target, None, None, home)
        if gap_m(feasible, before[0], obstacles) >= MARGIN_M:
            continue
        count -= 1
        avoiding(kept, feasible, obstacles)
        yield feasible, kept, target, obstacles, kept.solve(target, None, None, home)


@ARMS
def test_most_targets_that_the_plain_answer_touches_are_met_clear_of_obstacles(sections):
    clear = 0
    for feasible, _, target, obstacles, found in cases(sections, 10):
        lengths = np.array(found[0])
        assert found[2]
        assert np.allclose(tip_of(build_solver(feasible), lengths), target, atol=1e-6)
        assert feasible.excess(lengths).max() <= 1e-9
        clear += gap_m(feasible, lengths, obstacles) >= MARGIN_M
    assert clear >= 9


@ARMS
def test_an_answer_asked_again_from_itself_stays(sections):
    for _, solver, target, _, found in cases(sections, 8, seed=1):
        again = solver.solve(target, None, None, found[0])
        assert np.abs(np.subtract(again[0], found[0])).max() <= 1e-7


@ARMS
def test_far_obstacles_change_no_bit(sections):
    rng, feasible = np.random.default_rng(2), racks(sections)
    plain = build_solver(feasible)
    far = [type(each)(each.point - 5.0, each.normal) for each in some_obstacles(rng, 1)]
    kept = avoiding(build_solver(feasible), feasible, far)
    seed = tuple(feasible.home.tolist())
    for _ in range(20):
        target = tip_of(plain, posture(feasible, rng))
        expected = plain.solve(target, None, None, seed)
        if expected[5] == 1:  # one descent: it needs no other start
            assert kept.solve(target, None, None, seed) == expected
        seed = expected[0]
    kept.avoid([], 0.04, 0.005, 0.0, 0.02, 0.05)
    assert kept.solve(target, None, None, seed) == plain.solve(target, None, None, seed)


@pytest.mark.slow
@ARMS
def test_answers_along_a_line_past_obstacles_have_no_jump(sections):
    """From step to step the axes move in proportion to the tip, also where the potential begins."""
    moved, checked = [], 0
    for feasible, solver, target, obstacles, found in cases(sections, 5, seed=3):
        if gap_m(feasible, found[0], obstacles) < MARGIN_M:
            continue
        lengths, begin = found[0], np.array(target)
        for k in range(1, 41):
            tip = tuple((begin + np.array([0.0, 0.0, -5e-4 * k])).tolist())
            answer = solver.solve(tip, None, None, lengths)
            if not answer[2] or gap_m(feasible, answer[0], obstacles) < MARGIN_M:
                break
            moved.append(np.abs(np.subtract(answer[0], lengths)).max())
            lengths = answer[0]
            checked += 1
    assert checked > 80
    assert np.quantile(moved, 0.99) < 0.01


def slope(feasible, lengths, obstacles):
    """Gradient of the potential, by differences of fourth order."""
    found = []
    for step in 1e-5 * np.eye(len(lengths)):
        a, b, c, d = (potential(feasible, lengths + k * step, obstacles) for k in (-2, -1, 1, 2))
        found.append((a - 8.0 * b + 8.0 * c - d) / 12e-5)
    return np.array(found)


@ARMS
def test_an_answer_is_a_minimum_of_the_distance_from_home_and_the_potential(sections):
    """First-order conditions with the potential written out from its definition."""
    lefts, pushed = [], 0
    for feasible, _, target, obstacles, found in cases(sections, 12, seed=4):
        lengths = np.array(found.lengths)
        chain, limits = twists.of_tubes(feasible.sections), section_limits.of_tubes(feasible)
        _, J = twists.task(chain, 1.0, lengths, target)
        push = slope(feasible, lengths, obstacles)
        gradient = metric(feasible) @ (lengths - feasible.home) + push
        pushed += bool(np.linalg.norm(push) > 1e-3)
        normals = section_limits.binding_normals(limits, lengths)
        lefts.append(twists.multipliers_left(gradient, J, normals) / np.linalg.norm(gradient))
    assert pushed >= 7
    # A body that touches has no minimum but a kink: obstacles have edges. Most are settled.
    assert np.quantile(lefts, 0.6) <= 2e-4


@ARMS
def test_the_first_answer_is_taken_exactly_where_the_body_is_clear(sections):
    """Else starts of the library are tried, up to 32 of them or 300 steps, until one is clear."""
    firsts = seconds = 0
    rng, feasible = np.random.default_rng(6), racks(sections)
    solver, plain = build_solver(feasible), build_solver(feasible)
    few = tuning_for(feasible).tracking * tuning_for(feasible).ell_m
    for _ in range(100):
        obstacles, target = some_obstacles(rng, 12), plain.forward(tuple(posture(feasible, rng).tolist())).tip
        seed = posture(feasible, rng)
        found = avoiding(solver, feasible, obstacles).solve(target, None, None, tuple(seed.tolist()))
        gap = gap_m(feasible, found.lengths, obstacles)
        if found.starts == 1:
            followed = np.abs(np.subtract(found.lengths, seed)).max() <= few
            assert followed or gap >= MARGIN_M - 1e-5
            firsts += 1
        elif gap >= MARGIN_M:
            seconds += 1
        elif found != plain.solve(target, None, None, tuple(seed.tolist())):  # what is met in no way around
            assert found.starts == 33 or found.iterations >= 300
            assert gap < MARGIN_M + 1e-3
    assert firsts > 50
    assert seconds >= 1


@pytest.mark.parametrize("kind", ["plane", "sphere", "capsule", "box"])
def test_each_kind_of_obstacle_pushes_the_body_away(kind):
    """Beside a straight arm, where the plain answer keeps less than the margin."""
    feasible = racks(2)
    solver, plain = build_solver(feasible), build_solver(feasible)
    home = tuple(feasible.home.tolist())
    tip = (0.1, 0.0, 0.55)
    middle = np.array(plain.forward(plain.solve(tip, None, None, home).lengths).mid)
    turned = Rotation.from_euler("zy", (0.7, 0.4)).as_matrix()
    for side in np.arange(3) * 2 * np.pi / 3:
        out = np.array((np.cos(side), np.sin(side), 0.0))
        near = middle + (RADIUS_M + 0.5 * MARGIN_M) * out
        obstacle = {
            "plane": Plane(near, -out),
            "sphere": Capsule(near + 0.03 * out, near + 0.03 * out, 0.03),
            "capsule": Capsule(near + 0.03 * out - (0, 0, 0.02), near + 0.03 * out + (0, 0, 0.02), 0.03),
            "box": Box(near + 0.04 * out, turned, np.array((0.02, 0.03, 0.025))),
        }[kind]
        before = plain.solve(tip, None, None, home)
        found = avoiding(solver, feasible, [obstacle]).solve(tip, None, None, home)
        assert found.converged
        clearer = potential(feasible, found.lengths, [obstacle])
        assert clearer < potential(feasible, before.lengths, [obstacle])
        if kind != "plane":
            assert gap_m(feasible, found.lengths, [obstacle]) > gap_m(feasible, before.lengths, [obstacle])


def test_each_number_of_the_avoidance_counts():
    feasible = racks(2)
    home, tip = tuple(feasible.home.tolist()), (0.1, 0.0, 0.55)
    plain = build_solver(feasible).solve(tip, None, None, home)
    middle = np.array(build_solver(feasible).forward(plain.lengths).mid)
    beside = middle + np.array((0.0, 0.08, 0.0))
    row = Capsule(beside, beside, 0.03).packed.tolist()
    zone, force = zone_and_force(feasible)

    def around(radius=RADIUS_M, margin=MARGIN_M, begin=FROM_M, zone=zone, force=force):
        solver = build_solver(feasible)
        solver.avoid([row], radius, margin, begin, zone, force)
        return solver.solve(tip, None, None, home).lengths

    usual = around()
    assert usual != plain.lengths
    for changed in (
        {"radius": 0.05}, {"margin": 0.01}, {"begin": 0.2}, {"zone": 0.6 * zone}, {"force": 0.5 * force},
    ):  # fmt: skip
        assert np.abs(np.subtract(around(**changed), usual)).max() > 1e-5, changed
    assert around(radius=1e-3, margin=0.0, zone=1e-3) == pytest.approx(plain.lengths, abs=1e-9)


def test_bends_of_a_tendon_robot_keep_away_too():
    """Three sections, a tip alone: the body leads around a sphere beside it, and the tip is met."""
    (robot,) = load_named("tendon3").file.robots.values()
    assert isinstance(robot, TendonRobot)
    model = TendonModel(robot)
    rng, kept, free = np.random.default_rng(9), 0, 0
    straight = (0.0,) * len(model.axis_names)
    for _ in range(20):
        feasible = model.feasible
        assert model.statics is not None
        bends = feasible.pulled(rng.uniform(feasible.low, feasible.high)) / np.repeat(
            feasible.sections.backbone_m, 2
        )
        tip = model.forward(tuple(model.statics.pulls(bends).tolist())).tip_m
        target = Target(tip_m=tip)
        model.avoid([], 0.01, 0.002, 0.0)
        before = model.inverse(target, straight)
        body = model.shape(before.actuation, 200)
        side = np.cross(body[100] - body[99], rng.normal(size=3))
        at = body[100] + 0.016 * side / np.linalg.norm(side)
        sphere = Capsule(at, at, 0.005)
        if np.linalg.norm(at - tip) < 0.04:
            continue
        model.avoid([sphere.packed.tolist()], 0.01, 0.002, 0.02)
        found = model.inverse(target, straight)
        if not (before.converged and found.converged):
            continue
        free += 1
        gaps = [
            float(sphere.signed_distance(model.shape(each.actuation, 400)).min()) - 0.01
            for each in (before, found)
        ]
        kept += gaps[1] >= 0.002 - 1e-4 > gaps[0]
        assert np.linalg.norm(np.subtract(model.forward(found.actuation).tip_m, tip)) <= 1e-6
    model.avoid([], 0.01, 0.002, 0.0)
    assert free >= 5
    assert kept >= 0.7 * free


def test_the_end_of_a_backbone_keeps_away_where_the_tip_lies_behind_it():
    (robot,) = load_named("tendon3").file.robots.values()
    assert isinstance(robot, TendonRobot)
    geometry = robot.geometry.model_copy(update={"tip_offset_mm": (0.0, 0.0, -40.0)})
    model = TendonModel(robot.model_copy(update={"geometry": geometry}))
    straight = (0.0,) * len(model.axis_names)
    target = Target(tip_m=model.forward(model.of_arcs((0.5, 0.2, 0.0) * 3, straight)).tip_m)

    def end_m(actuation):
        pose = model.forward(actuation)
        return np.array(pose.tip_m) + 0.04 * np.array(pose.direction)

    before = model.inverse(target, straight)
    at = end_m(before.actuation) + 0.016 * np.array(model.forward(before.actuation).direction)
    model.avoid([Capsule(at, at, 0.005).packed.tolist()], 0.01, 0.002, 0.02)
    found = model.inverse(target, straight)
    assert found.converged
    assert np.linalg.norm(end_m(before.actuation) - at) - 0.015 < 0.002
    assert np.linalg.norm(end_m(found.actuation) - at) - 0.015 >= 0.002
