"""Closed form, bounded solver and stability count of the NumPy specification."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from contid.kinematics.cosserat.along_branch.effort import TICK
from contid.kinematics.cosserat.box_step import box_step
from contid.kinematics.cosserat.branch import critical_factor, equilibrium
from contid.kinematics.cosserat.closed_form import (
    arc_pressures,
    average_pressure,
    mid_and_tip_pressures,
    tip_and_direction_pressures,
    tip_pressures,
)
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.search import search
from contid.kinematics.cosserat.section import Rod, Section
from contid.kinematics.cosserat.solve import Problem, solve
from contid.kinematics.cosserat.stability import unstable_modes
from contid.kinematics.cosserat.task import Task
from tests.kinematics.cosserat_cases import GOLDEN, GRAM, hanging, lean, limits, one, section, two

SINGLE = [case for case in GOLDEN["ik"] if case["name"] != "pose family"]
FAMILY = [case for case in GOLDEN["ik"] if case["name"] == "pose family"]


@pytest.mark.parametrize("case", SINGLE, ids=[f"{c['name']} {c['load_g']} g" for c in SINGLE])
def test_golden_inverse(case: dict[str, Any]) -> None:
    expected = np.array(case["P"], float)
    k = len(expected) // 3
    rod = two() if k == 2 else one(case["seg0"])
    target = {key: np.array(value, float) for key, value in case["target"].items()}
    loads = hanging(case["load_g"])
    task = Task(target["p"], target.get("pm"))
    problem = Problem(rod, loads, task, limits(k), elements=48, tolerance=1e-9)
    found = solve(problem, np.full(3 * k, 0.5), np.cross(target["p"], loads.tip_force))
    assert found.met
    assert np.abs(found.pressures - expected).max() < 1e-7
    assert np.abs(found.base_moment - case["M0"]).max() < 1e-8


def test_closed_form_equals_golden() -> None:
    for case in SINGLE:
        if case["load_g"] == 0:
            target = {key: np.array(value, float) for key, value in case["target"].items()}
            if "pm" in target:
                found = mid_and_tip_pressures(two(), target["pm"], target["p"])
            else:
                found = tip_pressures(section(case["seg0"]), target["p"])
            assert np.abs(found - case["P"]).max() < 1e-12
    for case in FAMILY:
        tip = np.array(case["target"], float)
        found = tip_and_direction_pressures(two(), tip, lean(tip, case["beta"]), case["d1"])
        assert np.abs(found - case["P"]).max() < 1e-12


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0.0, 1.5), min_size=6, max_size=6), st.floats(0.0, 8.0))
def test_closed_form_inverts_the_sweep(pressures: list[float], tip_link: float) -> None:
    rod = two(tip_link)
    reached = equilibrium(rod, np.array(pressures), Loads()).sweep
    # A tip exactly over or behind the base of a section has no unique arc.
    if abs(reached.tip[2] - reached.ends[0][2]) + np.hypot(*(reached.tip - reached.ends[0])[:2]) < 1.0:
        return
    if tip_link > 0.0 and (reached.rotation.T @ (reached.tip - reached.ends[0]))[2] < 2.0:
        return
    found = mid_and_tip_pressures(rod, reached.ends[0], reached.tip)
    assert np.abs(found - pressures).max() < 1e-7


def test_stretch_inverts_elongation_on_both_sides_of_the_clamp() -> None:
    for kind in (0, 1):
        s = section(kind)
        for x in (-0.2, 0.0, 0.3, 1.5, 1.9, 2.4):
            modulus = s.modulus(x)[0]
            stretch = 1.0 + 3.0 * s.pair_force * x / (modulus * s.area)
            assert average_pressure(s, stretch) == pytest.approx(x, abs=1e-12)


@pytest.mark.parametrize(
    ("kind", "pressures", "degrees"),
    [
        (0, (1.5, 0.0, 0.0), 147.82752885),
        (0, (0.0, 1.5, 1.5), 184.60944159),
        (1, (1.5, 0.0, 0.0), 140.54757902),
        (1, (0.0, 1.5, 1.5), 179.97682256),
    ],
)
def test_bending_angles_of_variant_a(kind: int, pressures: tuple[float, ...], degrees: float) -> None:
    s = section(kind)
    turn = np.linalg.norm(s.inflated(np.array(pressures)).curvature) * s.length
    assert math.degrees(turn) == pytest.approx(degrees, abs=1e-7)
    # A full-arm gain makes the reference's other reading of the paper from this one.
    assert arc_pressures(s, np.array([0.0, 0.0, 50.0])) == pytest.approx(
        np.full(3, average_pressure(s, 50.0 / 42.0)), abs=1e-12
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31))
def test_box_step_is_the_bounded_minimum(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    J, r = rng.normal(size=(n + 1, n)), rng.normal(size=n + 1)
    low, high = -rng.uniform(0.0, 1.0, n), rng.uniform(0.0, 1.0, n) + 1e-9
    low[rng.random(n) < 0.3] = 0.0
    found = box_step(J.T @ J, J.T @ r, low, high)
    reference = lsq_linear(J, -r, (low, high), method="bvls", tol=1e-14).x
    assert np.linalg.norm(J @ found + r) <= np.linalg.norm(J @ reference + r) + 1e-9
    assert np.all((found >= low) & (found <= high))


def test_infeasible_target_ends_at_the_bounded_optimum_in_equilibrium() -> None:
    task = Task(np.array([-20.0, 15.0, 120.0]), np.array([8.0, -5.0, 60.0]))
    golden = [0.8028622581, 0.9286499913, 0.8549290418, 1.5, 0.6939556739, 1.1784085696]
    found = search(Problem(two(), Loads(), task, limits(2)), np.full(6, 0.5), effort=TICK)
    assert not found.outcome.met
    assert found.outcome.optimal
    assert found.stable
    assert np.abs(found.outcome.pressures - golden).max() < 4e-5
    loaded = search(Problem(two(), hanging(10.0), task, limits(2)), np.full(6, 0.5), effort=TICK)
    assert not loaded.outcome.met
    assert loaded.outcome.statics < 1e-9


@pytest.mark.parametrize("grams", [0.0, 5.0, 10.0])
def test_tip_and_direction_prefer_the_middle(grams: float) -> None:
    """The task is met and redundancy resolved towards the centre, from any start."""
    tip = np.array([20.0, -15.0, 118.0])
    problem = Problem(two(), hanging(grams), Task(tip, direction=lean(tip, 30.0)), limits(2), tolerance=1e-7)
    ends = []
    for start in (0.3, 0.6, 1.0):
        found = search(problem, np.full(6, start))
        assert found.outcome.met
        assert found.stable
        ends.append(found.outcome.pressures)
    assert np.abs(ends[0] - ends[1]).max() < 1e-3
    assert np.abs(ends[0] - ends[2]).max() < 1e-3


def test_closed_path_closes() -> None:
    """Repeatable: once around a circle with a held direction brings every pressure back."""
    pressures = np.full(6, 0.7)
    first = None
    for k in range(25):
        phi = 2.0 * math.pi * k / 24
        tip = np.array([20.0 * math.cos(phi), 20.0 * math.sin(phi), 118.0])
        problem = Problem(two(), hanging(5.0), Task(tip, direction=np.array([0.0, 0.0, 1.0])), limits(2))
        found = search(problem, pressures)
        assert found.outcome.met
        pressures = found.outcome.pressures
        first = pressures if first is None else first
    assert first is not None
    assert np.abs(pressures - first).max() < 1e-3


@pytest.mark.parametrize(
    ("rod", "bar", "grams"),
    [
        (one(), 0.0, 21.3),
        (one(), 0.5, 12.2),
        (one(), 1.0, 7.8),
        (two(), 0.0, 5.3),
        (two(), 0.5, 3.0),
        (two(), 1.0, 1.9),
    ],
)
def test_upright_buckling_masses(rod: Rod, bar: float, grams: float) -> None:
    pressures = np.full(rod.pressures, bar)
    upright = Loads(tip_force=np.array([0.0, 0.0, -30.0 * GRAM]))
    factor = critical_factor(rod, pressures, upright)
    assert factor is not None
    assert 30.0 * factor == pytest.approx(grams, abs=0.06)


def test_count_sees_every_buckling_mode() -> None:
    """An upright straight rod: two modes (both planes) past Euler's load, four past nine times it."""
    rod = one()
    for grams, modes in ((15.0, 0), (30.0, 2), (150.0, 2), (230.0, 4)):
        loads = Loads(tip_force=np.array([0.0, 0.0, -grams * GRAM]))
        assert unstable_modes(rod, np.zeros(3), np.zeros(3), loads, 12) == modes
    assert unstable_modes(rod, np.zeros(3), np.zeros(3), hanging(200.0), 12) == 0


def test_euler_column_in_closed_form() -> None:
    """Inextensible upright column: P = pi^2 EI / (4 L^2)."""
    real = section(0)
    rod = Rod(
        (
            Section(
                42.0,
                0.0,
                real.area * 1e7,
                real.inertia,
                real.torsion,
                4.9,
                4.5,
                (0.0, 0.0, 0.0, 0.0, 76130.0),
            ),
        )
    )
    euler = math.pi**2 * 76130e-6 * real.inertia / (4.0 * 42.0**2)
    factor = critical_factor(
        rod, np.zeros(3), Loads(tip_force=np.array([0.0, 0.0, -2.0 * euler])), elements=12
    )
    assert factor is not None
    assert 2.0 * factor == pytest.approx(1.0, rel=2e-3)
