"""The solver of arcs: frames against matrix exponentials, answers against the conditions of an optimum.

Of the lengths that meet a target an answer is the nearest to home, in a metric written out here; where
nothing meets it, the answer is a least error on the limits. Both are first-order conditions, with Jacobians
by complex steps through matrix exponentials.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contid.kinematics.arc.section_model import build_solver
from contid.kinematics.arc.solver import tuning_for
from tests.kernels.arc_cases import ARMS, CASES, metric, solved, target_of
from tests.kinematics.section_robots import random_lengths
from tests.oracles import section_limits, twists


@pytest.mark.parametrize(("name", "mode"), CASES)
def test_met_targets_are_met_inside_the_limits_and_nearest_to_home(name, mode):
    feasible = ARMS[name]()
    solver, ell_m = build_solver(feasible), tuning_for(feasible).ell_m
    chain, limits, M = twists.of_tubes(feasible.sections), section_limits.of_tubes(feasible), metric(feasible)
    free = 3 * feasible.sections.count > {"tip": 3, "direction": 5, "mid": 6, "rotation": 6}.get(mode, 8)
    seeds = random_lengths(feasible, 25, seed=5)
    settled = 0
    for lengths, seed in zip(random_lengths(feasible, 25, seed=4), seeds, strict=True):
        target = target_of(feasible, lengths, mode)
        answer = solved(solver, target, seed)
        found = np.array(answer.lengths)
        error, J = twists.task(chain, ell_m, found, **target)
        assert answer.converged
        assert answer.residual_m == pytest.approx(np.linalg.norm(error), abs=1e-11)
        assert answer.residual_m <= 1e-6
        over = section_limits.excess(limits, found)
        assert over.max() <= 1e-12
        assert answer.binding == sum(1 << int(k) for k in np.flatnonzero(over > -1e-9))
        if not free:
            continue
        gradient = M @ (found - feasible.home)
        left = twists.multipliers_left(gradient, J, section_limits.binding_normals(limits, found))
        settled += left <= 1e-6 * max(1e-2, float(np.linalg.norm(gradient)))
        again = solved(solver, target, found)
        assert np.abs(np.subtract(again.lengths, answer.lengths)).max() <= 1e-8
    # Along a bend radius homing can end at its step budget.
    assert settled >= 24 or not free


@pytest.mark.parametrize(("name", "mode"), CASES)
def test_what_is_not_met_is_a_least_error_on_the_limits(name, mode):
    feasible = ARMS[name]()
    solver, ell_m = build_solver(feasible), tuning_for(feasible).ell_m
    chain, limits = twists.of_tubes(feasible.sections), section_limits.of_tubes(feasible)
    rng, lefts = np.random.default_rng(6), [0.0]
    for k, lengths in enumerate(random_lengths(feasible, 10, seed=7)):
        target = target_of(feasible, lengths, mode)
        away = rng.normal(size=3)
        size = 2.0 * sum(feasible.upper) if k % 2 else 0.3 * sum(feasible.upper)
        shifted = np.array(target["tip"]) + size * away / np.linalg.norm(away)
        target["tip"] = tuple(shifted.tolist())
        answer = solved(solver, target, feasible.home)
        found = np.array(answer.lengths)
        error, J = twists.task(chain, ell_m, found, **target)
        assert answer.residual_m == pytest.approx(np.linalg.norm(error), abs=1e-9)
        assert answer.converged == (answer.residual_m <= 1e-6)
        over = section_limits.excess(limits, found)
        assert over.max() <= 1e-12
        assert answer.binding == sum(1 << int(k) for k in np.flatnonzero(over > -1e-9))
        if not answer.converged:
            normals = section_limits.binding_normals(limits, found)
            push = J.T @ error
            left = twists.multipliers_left(-push, np.zeros((0, len(found))), normals)
            lefts.append(left / max(1.0, float(np.linalg.norm(push))))
    # Along a bend radius Newton's method can end at its step budget.
    assert np.quantile(lefts, 0.7) <= 3e-6
    assert max(lefts) <= 1e-2


@pytest.mark.parametrize("name", ["cbha", "tri-rack 2", "tri-rack 3"])
def test_out_of_reach_no_multistart_of_random_postures_ends_nearer(name):
    """The nearest of many postures, and its neighbours, is no nearer than the answer."""
    feasible = ARMS[name]()
    solver, chain = build_solver(feasible), twists.of_tubes(feasible.sections)
    rng = np.random.default_rng(8)
    postures = random_lengths(feasible, 800, seed=9)
    tips = np.array([solver.forward(tuple(row)).tip for row in postures.tolist()])
    for _ in range(4):
        away = rng.normal(size=3) * (1.0, 1.0, 0.6)
        tip = 0.6 * sum(feasible.upper) * away / np.linalg.norm(away)
        answer = solver.solve(tuple(tip.tolist()), None, None, tuple(feasible.home.tolist()))
        off = np.linalg.norm(chain.placed(np.array(answer.lengths)).tip - tip)
        assert off == pytest.approx(answer.residual_m, abs=1e-9)
        nearest = postures[np.argsort(np.linalg.norm(tips - tip, axis=1))[:20]]
        least = float(np.linalg.norm(tips - tip, axis=1).min())
        assert answer.residual_m <= least + 1e-9
        for posture in nearest:
            other = solver.solve(tuple(tip.tolist()), None, None, tuple(posture.tolist()))
            assert other.residual_m >= 0.999 * answer.residual_m - 1e-6


@pytest.mark.parametrize(("name", "mode"), CASES)
def test_limits_can_be_reached_exactly(name, mode):
    """Targets of postures on a limit, which rounding must not put out of reach."""
    feasible = ARMS[name]()
    solver, limits = build_solver(feasible), section_limits.of_tubes(feasible)
    cube = np.random.default_rng(10).random((12, len(feasible.low)))
    for k, share in enumerate(cube):
        corner = np.where(share < 0.5, feasible.low, feasible.high) if k % 2 else feasible.low + 1.0 * share
        lengths = feasible.pulled(corner)
        answer = solved(solver, target_of(feasible, lengths, mode), feasible.home)
        assert answer.converged
        assert section_limits.excess(limits, np.array(answer.lengths)).max() <= 1e-12


@pytest.mark.parametrize("name", ARMS)
def test_a_turned_target_has_a_turned_answer(name):
    """Turned by the symmetry of the tubes, a third of a turn: each tube takes the length of its neighbour."""
    feasible = ARMS[name]()
    solver = build_solver(feasible)
    azimuths = np.array(feasible.sections.angles_rad[0])
    turn = azimuths[1] - azimuths[0]
    for lengths in random_lengths(feasible, 10, seed=14):
        tip = twists.of_tubes(feasible.sections).placed(lengths).tip
        turned = Rotation.from_euler("z", turn).apply(tip)
        here = solver.solve(tuple(tip.tolist()), None, None, tuple(feasible.home.tolist()))
        there = solver.solve(tuple(turned.tolist()), None, None, tuple(feasible.home.tolist()))
        # The library of starts is not symmetric: only answers of the first descent are.
        if here.starts <= 1 and there.starts <= 1:
            moved = np.roll(np.reshape(here.lengths, (-1, 3)), 1, axis=1).ravel()
            assert there.lengths == pytest.approx(moved, abs=1e-7)
