"""Golden catenaries, the properties of every hanging rope, and its Pythagorean-hodograph quintic."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid_ropes.catenary import Catenary, as_quintic, hang, stretch
from contid_ropes.ph.ends import CurveEnds, through
from tests.kinematics.ph_golden import GOLDEN, MM, two_section_pose

coordinate = st.floats(-1.0, 1.0)
point = st.tuples(coordinate, coordinate, coordinate)


def rope(start: tuple[float, float, float], end: tuple[float, float, float], length_m: float) -> Catenary:
    found = hang(start, end, length_m)
    assert found is not None
    return found


def worst_mm(hanging: Catenary, curve_points: np.ndarray) -> float:
    """Greatest distance at equal arc length [mm]."""
    return float(np.linalg.norm(hanging.points(len(curve_points)) - curve_points, axis=1).max()) / MM


def test_golden_catenary() -> None:
    golden = GOLDEN["catenary"]
    found = rope((0, 0, 0), (golden["X"] * MM, 0, golden["Z"] * MM), golden["ell"] * MM)
    assert found.a_m / MM == pytest.approx(golden["a"], rel=1e-13)
    assert -found.a_m * math.asinh(found.slope_start) / MM == pytest.approx(golden["x0"], rel=1e-13)
    assert found.start_direction[::2] == pytest.approx(golden["t0"], abs=1e-14)
    assert found.end_direction[::2] == pytest.approx(golden["t1"], abs=1e-14)
    assert [v / MM for v in found.at(0.4)[::2]] == pytest.approx(golden["mid"], abs=1e-10)


def test_golden_catenary_as_a_quintic() -> None:
    golden, data = GOLDEN["ph_catenary"], GOLDEN["catenary"]
    found = rope((0, 0, 0), (data["X"] * MM, 0, data["Z"] * MM), data["ell"] * MM)
    fit = as_quintic(found)
    assert fit.end_speed_m / MM == pytest.approx(golden["m"], rel=1e-13)
    np.testing.assert_allclose(fit.curve.control_points_m / MM, golden["CP"], rtol=0, atol=1e-9)
    assert fit.curve.bending_energy * MM == pytest.approx(golden["Eb"], rel=1e-11)
    assert worst_mm(found, fit.curve.evenly(201)) / 8.0 == pytest.approx(0.095, abs=5e-4)  # % of 800 mm


def golden_chain() -> tuple[Catenary, np.ndarray]:
    """Rope and tangent of the second tip of the reference's closed chain."""
    golden = GOLDEN["chain_rope"]
    b, _, _ = two_section_pose(np.array(golden["l_1"]) * MM)
    c, tangent, _ = two_section_pose(np.array(golden["l_2"]) * MM)
    c = c + np.array(golden["base2"]) * MM
    np.testing.assert_allclose(c / MM, golden["C"], rtol=0, atol=1e-9)
    return rope(tuple(b.tolist()), tuple(c.tolist()), 1.0), tangent


def test_golden_chain() -> None:
    golden, link = GOLDEN["chain_rope"], GOLDEN["chain_link3"]
    found, tangent = golden_chain()
    assert found.a_m / MM == pytest.approx(golden["cat_a"], rel=1e-12)
    # The reference left xi at its solver's tolerance, 2e-13.
    assert found.start_direction == pytest.approx(golden["tB_rope"], abs=1e-12)
    assert found.end_direction == pytest.approx(golden["tC_rope"], abs=1e-12)
    fit = as_quintic(found)
    assert fit.end_speed_m / MM == pytest.approx(golden["m"], rel=1e-12)
    np.testing.assert_allclose(fit.curve.control_points_m / MM, golden["CP"], rtol=0, atol=1e-9)
    # Link 3 runs from the tip back to the base: its tangents are the negatives of the arm's.
    assert (-tangent).tolist() == pytest.approx(link["t_start"], abs=1e-12)
    base = tuple(v * MM for v in golden["base2"])
    back = through(CurveEnds(found.end_m, base, tuple((-tangent).tolist()), (0, 0, -1)), 0.23)
    assert back.end_speed_m / MM == pytest.approx(link["m"], rel=1e-12)
    np.testing.assert_allclose(back.curve.control_points_m / MM, link["CP"], rtol=0, atol=1e-9)


def test_the_chain_s_rope_is_within_a_twentieth_of_a_millimetre() -> None:
    found, _ = golden_chain()
    assert worst_mm(found, as_quintic(found).curve.evenly(401)) < 0.05


@given(point, point, st.floats(1e-6, 20.0))
@settings(deadline=None, max_examples=100)
def test_every_rope_has_its_ends_its_length_and_the_equation_of_the_catenary(
    start: tuple[float, float, float], end: tuple[float, float, float], slack: float
) -> None:
    length = (math.dist(start, end) + 1e-3) * (1.0 + slack)
    found = rope(start, end, length)
    assert found.at(length) == pytest.approx(end, abs=1e-8 * length)
    assert found.at(0.0) == start
    s = np.linspace(0.0, length, 401)
    points = found.points(401)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.max(steps) <= s[1] * (1.0 + 1e-9) + 1e-11
    # Vertical pull minus horizontal pull grows with the weight passed: slope is linear in arc length.
    slopes = [d[2] / math.hypot(d[0], d[1]) for d in map(found.direction_at, (0.0, length / 2, length))]
    assert slopes[1] == pytest.approx((slopes[0] + slopes[2]) / 2, abs=1e-6 * (abs(slopes[0]) + 1.0))
    assert found.lowest[2] <= np.min(points[:, 2]) + 1e-9 * length


def test_turning_the_rope_round_gives_the_same_rope() -> None:
    one, other = rope((0, 0, 0.1), (0.5, 0.3, 0.4), 0.9), rope((0.5, 0.3, 0.4), (0, 0, 0.1), 0.9)
    np.testing.assert_allclose(one.points(50), other.points(50)[::-1], atol=1e-14)
    assert one.lowest == pytest.approx(other.lowest, abs=1e-14)
    assert one.pull_n(2.0) == pytest.approx(other.pull_n(2.0)[::-1])


def test_both_ends_together_carry_the_weight() -> None:
    found = rope((0, 0, 0), (0.6, 0, 0.05), 0.8)
    start, end = found.pull_n(3.0)
    assert -start * found.start_direction[2] + end * found.end_direction[2] == pytest.approx(3.0)


def test_limits_short_taut_folded() -> None:
    assert hang((0, 0, 0), (1, 0, 0), 0.999) is None
    assert hang((0, 0, 0), (0, 0, 0), 0.0) is None
    taut = rope((0, 0, 0), (0.6, 0, 0.8), 1.0)
    assert taut.at(0.25) == pytest.approx((0.15, 0, 0.2))
    assert taut.start_direction == pytest.approx((0.6, 0, 0.8))
    assert taut.lowest == (0, 0, 0)
    beside = rope((0.1, -0.2, 0.3), (0.5, 0.2, 1.0), 0.9)
    assert beside.at(0.45) == pytest.approx((0.3, 0.0, 0.65))
    folded = rope((0, 0, 1), (0, 0, 1), 1.0)
    assert folded.lowest[2] == pytest.approx(0.5, abs=1e-8)
    upright = rope((0, 0, 0), (0, 0, 0.5), 1.0)
    assert upright.lowest[2] == pytest.approx(-0.25, abs=1e-8)


@given(st.floats(1e-6, 300.0))
@settings(deadline=None)
def test_stretch_inverts_its_equation(xi: float) -> None:
    surplus = math.expm1(2.0 * (xi + math.log(-math.expm1(-2.0 * xi) / (2.0 * xi)))) if xi > 0.3 else None
    if surplus is None:
        q = xi * xi
        surplus = math.expm1(2.0 * (q / 6 - q**2 / 180 + q**3 / 2835 - q**4 / 37800 + q**5 / 467775))
    assert stretch(surplus) == pytest.approx(xi, rel=1e-11)
