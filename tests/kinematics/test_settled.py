"""Settled answers: solved again they do not move, and no neighbour with the same tip is nearer to home.

Targets are drawn as bends and lengths of sections and put into space by rotation matrices of scipy, not by
the kinematics under test. The long form is ``python -m tests.oracles``.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.section_model import build_solver
from contid.kinematics.model import build_model
from contid.robot_file.load import load_named
from tests.oracles import rods
from tests.oracles.arcs import bends, random_posture, tip_and_tangent

#: How far an answer may move when it is solved again from itself [m]: 1e-5 mm.
FIXED_M = 1e-8


def feasible_of(name: str) -> Feasible:
    (robot,) = load_named(name).file.robots.values()
    feasible: Feasible = build_model(robot).feasible  # type: ignore[attr-defined]  # models of sections have it
    return feasible


@pytest.mark.parametrize("directed", [False, True], ids=["tip", "direction"])
@pytest.mark.parametrize("name", ["trirack2", "cbha"])
def test_an_answer_solved_again_does_not_move(name, directed):
    feasible = feasible_of(name)
    solver = build_solver(feasible)
    rng = np.random.default_rng(16)
    home = tuple(feasible.home.tolist())
    for _ in range(100):
        tip, tangent = tip_and_tangent(feasible, random_posture(feasible, rng, np.pi / 3))
        goal = tuple(tip.tolist()), tuple(tangent.tolist()) if directed else None, None
        first = solver.solve(*goal, home)
        again = solver.solve(*goal, first[0])
        assert first[2]
        assert again[2]
        np.testing.assert_allclose(again[0], first[0], rtol=0.0, atol=FIXED_M)
        assert again[1] <= 1e-9


def test_a_first_answer_meets_its_target_to_the_bar_of_a_run():
    """Homing ended on its merit with 4.6e-6 mm left, and no tick would have asked again."""
    feasible = feasible_of("trirack2")
    solver = build_solver(feasible)
    tip = (0.14475242796261145, 0.07581107539312025, 0.7887432254777751)
    tangent = (0.19387994773945283, 0.3675395043664483, 0.9095742292933616)
    lengths, _, met, *_ = solver.solve(tip, tangent, None, tuple(feasible.home.tolist()))
    assert met
    assert np.linalg.norm(tip_and_tangent(feasible, np.array(lengths))[0] - tip) < 1e-9


def test_the_target_that_moved_by_8_mm_of_rack():
    feasible = feasible_of("trirack2")
    solver = build_solver(feasible)
    tip = (-0.1022, 0.1669, 0.4525)
    for seed in (feasible.low + 0.05, feasible.low + 0.001, feasible.home):
        first = solver.solve(tip, None, None, tuple(seed.tolist()))
        np.testing.assert_allclose(
            solver.solve(tip, None, None, first[0])[0], first[0], rtol=0.0, atol=FIXED_M
        )


@pytest.mark.parametrize("count", [pytest.param(10, marks=pytest.mark.campaign), 3])
def test_no_neighbour_with_the_same_tip_is_nearer_to_home(count):
    """SLSQP from the answer and around it finds no lower distance at the same tip within the limits."""
    feasible = feasible_of("trirack2")
    solver = build_solver(feasible)
    rng = np.random.default_rng(17)

    def distance(lengths: np.ndarray) -> float:
        total, homes = 0.0, feasible.home[::3]
        for d, arc, home in zip(feasible.sections.radius_m, bends(feasible, lengths), homes, strict=True):
            theta, _, length = arc
            total += 1.5 * (length - home) ** 2 + 0.5 * max(1.5 * d * d, 0.5 * home**2) * theta**2
        return total

    for _ in range(count):
        tip, _ = tip_and_tangent(feasible, random_posture(feasible, rng, np.pi / 3))
        found = np.array(solver.solve(tuple(tip.tolist()), None, None, tuple(feasible.home.tolist()))[0])
        constraints = [
            {"type": "eq", "fun": lambda q, tip=tip: tip_and_tangent(feasible, q)[0] - tip},
            {"type": "ineq", "fun": lambda q: -feasible.excess(q)},
        ]
        for spread in (0.0, 1e-3):
            start = found + rng.normal(size=len(found)) * spread
            best = minimize(distance, start, constraints=constraints, method="SLSQP", options={"ftol": 1e-14})
            off = np.linalg.norm(tip_and_tangent(feasible, best.x)[0] - tip)
            if (
                np.linalg.norm(best.x - found) < 0.02
                and off < 1e-7
                and np.max(feasible.excess(best.x)) < 1e-7
            ):
                assert distance(found) <= best.fun + 1e-6


@pytest.mark.parametrize("share", [rods.NEAR_REST, 1.0], ids=["near rest", "box"])
@pytest.mark.parametrize("directed", [False, True], ids=["tip", "direction"])
def test_an_answer_of_two_pneumatic_sections_solved_again_does_not_move(share, directed):
    missed, moved = rods.moves(share, directed, 0.0, 200, seed=7)
    assert missed == 0
    assert max(moved) <= rods.FIXED_BAR


@pytest.mark.parametrize(("load_n", "cases", "seed"), [(0.0, 1000, 103), (0.05, 300, 107)])
def test_a_first_answer_does_not_end_beside_a_saddle(load_n, cases, seed):
    """Near rest three answers of the first set moved by up to 1.5 bar, and two of the second by 0.74 bar."""
    missed, moved = rods.moves(rods.NEAR_REST, False, load_n, cases, seed=seed)
    assert missed == 0
    assert max(moved) <= rods.FIXED_BAR


@pytest.mark.parametrize(("directed", "cases"), [(False, (1660, 3768)), (True, (4807,))])
def test_an_answer_whose_elements_were_doubled_is_asked_until_it_stays(directed, cases):
    """Whether the arm gets there was computed with fewer elements; these moved by up to 0.13 bar."""
    missed, moved = rods.moves(1.0, directed, 0.05, cases)
    assert missed == 0
    assert max(moved) <= rods.FIXED_BAR


def test_an_answer_whose_straight_path_ends_at_another_equilibrium_is_refused():
    """With the pressures that would meet this target a walk from its seed is 85 mm away, without a snap."""
    missed, _ = rods.moves(1.0, True, 0.05, (2677,))
    assert missed == 1
