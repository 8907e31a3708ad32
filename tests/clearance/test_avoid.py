"""Redundant axes keep the body away from obstacles: clear answers, continuous, unchanged where it is free."""

import numpy as np
import pytest

from contid.kernels import load
from contid.kinematics.arc.avoid import _distance
from contid.kinematics.arc.section_model import build_solver
from contid.kinematics.arc.solve import SectionSolver
from contid.kinematics.arc.task import tuning_for
from tests.clearance.around import (
    MARGIN_M,
    around,
    avoiding,
    gap_m,
    posture,
    racks,
    some_obstacles,
)

ARMS = pytest.mark.parametrize("sections", [2, 3])


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
    for feasible, _, target, obstacles, found in cases(sections, 25):
        lengths = np.array(found[0])
        assert found[2]
        assert np.allclose(tip_of(build_solver(feasible), lengths), target, atol=1e-6)
        assert feasible.excess(lengths).max() <= 1e-9
        clear += gap_m(feasible, lengths, obstacles) >= MARGIN_M
    assert clear >= 23


@ARMS
def test_an_answer_asked_again_from_itself_stays(sections):
    for _, solver, target, _, found in cases(sections, 25, seed=1):
        again = solver.solve(target, None, None, found[0])
        assert np.abs(np.subtract(again[0], found[0])).max() <= 1e-7


@ARMS
def test_far_obstacles_change_no_bit(sections):
    rng, feasible = np.random.default_rng(2), racks(sections)
    plain = build_solver(feasible)
    far = [type(each)(each.point - 5.0, each.normal) for each in some_obstacles(rng, 1)]
    kept = avoiding(build_solver(feasible), feasible, far)
    seed = tuple(feasible.home.tolist())
    for _ in range(50):
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
    for feasible, solver, target, obstacles, found in cases(sections, 12, seed=3):
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
    assert checked > 200
    assert np.quantile(moved, 0.99) < 0.01


@pytest.mark.slow
@ARMS
def test_the_gradient_of_the_potential_is_that_of_differences(sections):
    rng, feasible = np.random.default_rng(4), racks(sections)
    active = 0
    for _ in range(40):
        avoid, lengths = around(feasible, some_obstacles(rng, 10)), posture(feasible, rng)
        found = avoid.potential(feasible.sections, lengths)
        active += found.value > 0.0
        for k in range(len(lengths)):
            step = np.zeros(len(lengths))
            step[k] = 1e-7
            ends = [avoid.potential(feasible.sections, lengths + s * step).value for s in (1, -1)]
            assert found.gradient[k] == pytest.approx((ends[0] - ends[1]) / 2e-7, rel=1e-4, abs=1e-5)
    assert active > 10


def test_the_distance_of_packed_obstacles_is_that_of_clearance():
    rng = np.random.default_rng(5)
    for each in some_obstacles(rng, 30):
        points = rng.uniform(-0.5, 0.8, (50, 3))
        distance, outwards = _distance(each.packed, points)
        assert distance == pytest.approx(each.signed_distance(points), abs=1e-15)
        ahead = each.signed_distance(points + 1e-7 * outwards)
        assert (ahead - distance) / 1e-7 == pytest.approx(np.ones(50), abs=1e-4)


@pytest.mark.slow
@ARMS
def test_a_body_that_is_too_near_is_never_clear(sections):
    rng, feasible = np.random.default_rng(6), racks(sections)
    kept = 0
    for _ in range(200):
        obstacles, lengths = some_obstacles(rng, 10), posture(feasible, rng)
        gap, clear = (
            gap_m(feasible, lengths, obstacles),
            around(feasible, obstacles).clear(feasible.sections, lengths),
        )
        kept += clear
        assert gap >= MARGIN_M if clear else gap < MARGIN_M + 1e-3
    assert 20 < kept < 180


@pytest.mark.slow
@ARMS
@pytest.mark.skipif(load("arc") is None, reason="no kernel")
def test_the_kernel_answers_as_its_twin(sections):
    for feasible, _, target, obstacles, found in cases(sections, 8, seed=7):
        twin = avoiding(SectionSolver(feasible, tuning_for(feasible)), feasible, obstacles)
        expected = twin.solve(target, None, None, tuple(feasible.home.tolist()))
        assert found[1:4] == pytest.approx(expected[1:4], abs=1e-9)
        assert found[5] == expected[5]
        assert found[0] == pytest.approx(expected[0], abs=1e-7)
