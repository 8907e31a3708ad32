"""Inverse statics against the golden rows of the reference, closed forms and Euler."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.kinematics.cosserat.engine import Limits
from contid.kinematics.cosserat.section import Loads, Rod, Section
from contid.targets import ZERO3, Vec3
from tests.kinematics.cosserat_cases import GOLDEN, GRAM, lean, one, rod_of, section, solver, two
from tests.oracles.rod_energy import variation

SINGLE = [case for case in GOLDEN["ik"] if case["name"] != "pose family"]
FAMILY = [case for case in GOLDEN["ik"] if case["name"] == "pose family"]


def vec(values: Any) -> Vec3:
    x, y, z = (float(value) for value in values)
    return x, y, z


@pytest.mark.parametrize("case", SINGLE, ids=[f"{c['name']} {c['load_g']} g" for c in SINGLE])
def test_golden_inverse(case: dict[str, Any]) -> None:
    expected = np.array(case["P"], float)
    rod = rod_of(case)
    target, force = case["target"], (0.0, 0.0, case["load_g"] * GRAM)
    engine = solver(rod, elements=48, tolerance=1e-9)
    mid = vec(target["pm"]) if "pm" in target else None
    found = engine.inverse(vec(target["p"]), mid, None, force, [0.5] * len(expected))
    assert found.met
    assert found.stable
    assert np.abs(np.array(found.pressures_bar) - expected).max() < 1e-7
    moment = engine.forward(found.pressures_bar, force).base_moment_nmm
    assert np.abs(np.array(moment) - case["M0"]).max() < 1e-7


def test_a_golden_member_of_the_family_reaches_its_pose() -> None:
    """Biarcs with one free parameter: the reference's pressures are one answer, the inverse's another."""
    engine = solver(two())
    for case in FAMILY:
        tip = np.array(case["target"], float)
        direction = lean(tip, case["beta"])
        golden = engine.forward(case["P"], ZERO3)
        assert np.abs(np.array(golden.tip_mm) - tip).max() < 1e-10
        assert np.abs(np.array(golden.rotation[2::3]) - direction).max() < 1e-12
        if min(case["P"]) < 0.0 or max(case["P"]) > 1.5:
            continue
        found = engine.inverse(vec(tip), None, vec(direction), ZERO3, case["P"])
        assert found.met
        # The nearest to the centre, so not farther from it than the golden one.
        away = [float(np.linalg.norm(np.array(p) - 0.75)) for p in (found.pressures_bar, case["P"])]
        assert away[0] <= away[1] + 1e-9


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0.0, 1.5), min_size=6, max_size=6), st.floats(0.0, 8.0))
def test_mid_point_and_tip_determine_the_pressures(pressures: list[float], tip_link: float) -> None:
    """From far away, without a load."""
    engine = solver(two(tip_link), tolerance=1e-8)
    reached = engine.forward(pressures, ZERO3)
    beyond = np.subtract(reached.tip_mm, reached.mid_mm)
    # A tip exactly over or behind the base of a section has no unique arc.
    if abs(beyond[2]) + np.hypot(*beyond[:2]) < 1.0:
        return
    if tip_link > 0.0 and (np.array(reached.rotation).reshape(3, 3).T @ beyond)[2] < 2.0:
        return
    found = engine.inverse(reached.tip_mm, reached.mid_mm, None, ZERO3, [0.75] * 6)
    assert found.met
    assert np.abs(np.array(found.pressures_bar) - pressures).max() < 1e-6


@pytest.mark.parametrize("kind", [0, 1])
@pytest.mark.parametrize("bar", [0.02, 0.3, 1.5, 1.9, 2.4])
def test_a_stretch_determines_the_pressure_on_both_sides_of_the_clamp(kind: int, bar: float) -> None:
    """``stretch - 1 = 6 x A_c / (E(x) A)`` (eq. 18): tips on the axis of one section, from rest."""
    s = section(kind)
    stretch = 1.0 + 3.0 * s.pair_force * bar / (s.modulus(bar)[0] * s.area)
    wide = Limits(np.full(3, -0.5), np.full(3, 3.0), np.full(3, 1.0))
    engine = solver(Rod((s,)), limits=wide, tolerance=1e-10)
    found = engine.inverse((0.0, 0.0, stretch * s.length), None, None, ZERO3, [0.0] * 3)
    assert found.met
    assert found.pressures_bar == pytest.approx([bar] * 3, abs=1e-8)


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
    rotation = np.array(solver(Rod((s,))).forward(pressures, ZERO3).rotation).reshape(3, 3)
    assert math.cos(math.radians(degrees)) == pytest.approx(rotation[2, 2], abs=1e-9)


def test_infeasible_target_ends_at_the_bounded_optimum_in_equilibrium() -> None:
    golden = [0.8028622581, 0.9286499913, 0.8549290418, 1.5, 0.6939556739, 1.1784085696]
    target = (-20.0, 15.0, 120.0), (8.0, -5.0, 60.0), None
    found = solver(two()).inverse(*target, ZERO3, [0.5] * 6)
    assert not found.met
    assert found.optimal
    assert found.stable
    assert np.abs(np.array(found.pressures_bar) - golden).max() < 4e-5
    assert found.pressures_bar[3] == 1.5
    loaded = solver(two()).inverse(*target, (0.0, 0.0, 10.0 * GRAM), [0.5] * 6)
    assert not loaded.met
    assert loaded.balance_nmm < 1e-9


@pytest.mark.parametrize("grams", [0.0, 5.0, 10.0])
def test_tip_and_direction_prefer_the_middle(grams: float) -> None:
    """The task is met and redundancy resolved towards the centre, from any start."""
    tip = np.array([20.0, -15.0, 118.0])
    engine, ends = solver(two(), tolerance=1e-7), []
    for start in (0.3, 0.6, 1.0):
        found = engine.inverse(vec(tip), None, vec(lean(tip, 30.0)), (0.0, 0.0, grams * GRAM), [start] * 6)
        assert found.met
        assert found.stable
        ends.append(np.array(found.pressures_bar))
    assert np.abs(ends[0] - ends[1]).max() < 1e-6
    assert np.abs(ends[0] - ends[2]).max() < 1e-6


def test_closed_path_closes() -> None:
    """Repeatable: once around a circle with a held direction brings every pressure back."""
    engine = solver(two())
    pressures: tuple[float, ...] = (0.7,) * 6
    first = None
    for k in range(25):
        phi = 2.0 * math.pi * k / 24
        tip = (20.0 * math.cos(phi), 20.0 * math.sin(phi), 118.0)
        found = engine.inverse(tip, None, (0.0, 0.0, 1.0), (0.0, 0.0, 5.0 * GRAM), pressures)
        assert found.met
        pressures = found.pressures_bar
        first = pressures if first is None else first
    assert first is not None
    assert np.abs(np.subtract(pressures, first)).max() < 1e-6


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
    factor = solver(rod).critical([bar] * rod.pressures, (0.0, 0.0, -30.0 * GRAM), 1.0)
    assert factor is not None
    assert 30.0 * factor == pytest.approx(grams, abs=0.06)


@pytest.mark.parametrize(("grams", "modes"), [(15.0, 0), (21.0, 0), (22.0, 2), (150.0, 2), (230.0, 4)])
def test_every_buckling_mode_is_seen(grams: float, modes: int) -> None:
    """An upright straight rod: two modes (both planes) past Euler's load, four past nine times it.

    The determinant of the balance is positive at all of these, so its sign would not do.
    """
    engine, force = solver(one(), elements=12), (0.0, 0.0, -grams * GRAM)
    counted = variation(one(), np.zeros(3), Loads(tip_force=np.array(force)), np.zeros(3)).unstable
    assert counted == modes
    assert (engine.near([0.0] * 3, force, (0.0, 0.0, 0.0)) is not None) == (modes == 0)
    assert engine.near([0.0] * 3, (0.0, 0.0, 200.0 * GRAM), (0.0, 0.0, 0.0)) is not None


def test_euler_column_in_closed_form() -> None:
    """Inextensible upright column: P = pi^2 EI / (4 L^2)."""
    real = section(0)
    modulus = (0.0, 0.0, 0.0, 0.0, 76130.0)
    column = Section(42.0, 0.0, real.area * 1e7, real.inertia, real.torsion, 4.9, 4.5, modulus)
    euler = math.pi**2 * 76130e-6 * real.inertia / (4.0 * 42.0**2)
    engine = solver(Rod((column,)), elements=12)
    factor = engine.critical([0.0] * 3, (0.0, 0.0, -2.0 * euler), 1.0)
    assert factor is not None
    assert 2.0 * factor == pytest.approx(1.0, rel=2e-3)
    assert engine.critical([0.0] * 3, (0.0, 0.0, -euler), 1.01) == pytest.approx(1.0, rel=2e-3)
    assert engine.critical([0.0] * 3, (0.0, 0.0, -euler), 0.99) is None
