"""Where the solver of arcs starts: closed forms, biarcs, the library; and what its tuning changes."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.section_model import build_solver
from contid.kinematics.arc.sections import Sections
from contid.kinematics.arc.solver import SectionSolution, tuning_for
from tests.kernels.arc_cases import ARMS, metric, solved, target_of
from tests.kinematics.section_robots import RACKS, ROBOTS, random_lengths
from tests.oracles import section_limits, twists


def test_the_closed_form_of_one_section_needs_no_descent():
    """With a rigid piece; the tips are placed by exponentials."""
    feasible = Feasible(Sections((0.035,), (RACKS,), (0.02,)), (0.050,), (0.650,))
    solver, chain = build_solver(feasible), twists.of_tubes(feasible.sections)
    for lengths in random_lengths(feasible, 200, seed=11):
        if np.ptp(lengths) > 0.15:  # beyond half a turn two arcs end there
            continue
        answer = solver.solve(tuple(chain.placed(lengths).tip.tolist()), None, None, (0.05, 0.6, 0.1))
        assert answer.starts == 0
        assert answer.iterations == 0
        assert answer.lengths == pytest.approx(lengths, abs=1e-10)


def test_two_arcs_through_tip_and_mid_need_no_descent():
    for name in ("cbha", "tri-rack 2"):
        feasible = ARMS[name]()
        solver = build_solver(feasible)
        exact = 0
        for lengths in random_lengths(feasible, 100, seed=12):
            answer = solved(solver, target_of(feasible, lengths, "mid"), feasible.home)
            assert answer.converged
            if answer.starts == 0:
                exact += 1
                assert answer.iterations == 0
                assert answer.residual_m <= 1e-12
        assert exact > 60


def test_a_closed_form_outside_the_limits_is_not_taken():
    feasible = ARMS["tri-rack"]()
    answer = build_solver(feasible).solve((0.1, 0.0, 0.05), None, None, tuple(feasible.home.tolist()))
    assert not answer.converged
    assert answer.starts > 0
    assert section_limits.excess(section_limits.of_tubes(feasible), np.array(answer.lengths)).max() <= 1e-12


def test_biarcs_are_starts_of_directed_targets():
    """Without the library of starts, from the retracted arm: two sections are met from biarcs."""
    feasible = ARMS["tri-rack 2"]()
    only = build_solver(feasible, dataclasses.replace(tuning_for(feasible), starts=0))
    starts = []
    for lengths in random_lengths(feasible, 200, seed=13):
        answer = solved(only, target_of(feasible, lengths, "direction"), feasible.low)
        assert answer.converged
        starts.append(answer.starts)
    assert max(starts) <= 4
    assert sum(each == 2 for each in starts) >= 10  # the best of them is the first


def test_a_seed_that_meets_its_target_is_kept():
    """`Tuning.still_m` and `still_error_m`: nothing moves where the first step is shorter."""
    feasible = ARMS["tri-rack 2"]()
    solver = build_solver(feasible)
    for lengths in random_lengths(feasible, 20, seed=17):
        target = target_of(feasible, lengths, "tip")
        settled = solved(solver, target, np.array(solved(solver, target, feasible.home).lengths))
        again = solved(solver, target, np.array(settled.lengths))
        assert again.lengths == settled.lengths
        assert again.iterations <= 2


def test_each_number_of_the_tuning_counts():
    """Changed on its own, each changes what it is for."""
    feasible = ARMS["tri-rack 2"]()
    tuning = tuning_for(feasible)
    cold = (0.02, 0.0, 0.06), None, None, (0.1,) * 6  # out of reach

    def asked(goal: tuple[Any, ...] = cold, **changed: float) -> SectionSolution:
        return build_solver(feasible, dataclasses.replace(tuning, **changed)).solve(*goal)  # type: ignore[arg-type]

    plain = asked()
    assert plain.starts == 1 + tuning.starts
    assert asked(starts=5).starts == 6
    assert asked(tracking=1e3).starts == tuning.agreeing
    assert asked(tracking=1e3, agreeing=2).starts == 2
    assert asked(settling=3).iterations < plain.iterations
    assert asked(iterations=2).iterations != plain.iterations
    assert asked(tolerance_m=1.0).converged
    beyond = (0.0, 0.3, 1.5), None, None, tuple(feasible.home.tolist())
    assert asked(beyond).starts == tuning.agreeing
    assert asked(beyond, agreeing=4).starts == 4
    assert asked(slow=10.0).iterations != plain.iterations
    reached = (0.2, 0.1, 0.45), None, None, tuple(feasible.high.tolist())
    settled = asked(reached)
    for changed in (
        {"home_steps": 0}, {"home_steps": 2}, {"near": 1e3}, {"near": 1e-3}, {"contraction": 10.0},
        {"contraction": 0.0}, {"slow": 0.0}, {"home_tolerance_m": 1e-3}, {"weight": 1e-2}, {"ell_m": 0.02},
    ):  # fmt: skip
        other = asked(reached, **changed)
        assert other.converged
        assert other != settled, changed
    home = feasible.home
    M = metric(feasible)

    def distance(answer: SectionSolution) -> float:
        away = np.array(answer.lengths) - home
        return float(away @ M @ away)

    assert distance(asked(reached, home_steps=0)) > 1.01 * distance(settled)
    near = reached[0], None, None, tuple((np.array(settled.lengths) + 1e-5).tolist())
    kept = asked(near, still_m=1.0, still_error_m=1.0, tolerance_m=1.0)
    assert kept.lengths == near[3]
    assert asked(near, still_m=1.0, tolerance_m=1.0).lengths != near[3]
    assert asked(near, still_error_m=1.0, tolerance_m=1.0).lengths != near[3]


def test_following_out_of_reach_tries_few_starts_and_a_cold_start_many():
    solver = build_solver(ROBOTS["tri-rack 2"]())
    tip_m = (0.02, 0.0, 0.06)
    cold = solver.solve(tip_m, None, None, (0.1,) * 6)
    assert not cold.converged
    assert cold.starts > 3
    warm = solver.solve(tip_m, None, None, cold.lengths)
    assert warm.starts <= 3
    assert warm.residual_m == pytest.approx(cold.residual_m, rel=1e-9)
