"""Golden curves PH-1..PH-6, and the properties every quintic has."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from contid_ropes.ph.ends import BRANCHES, CurveEnds, least_energy, through
from contid_ropes.ph.lift import lift, product, turned
from contid_ropes.ph.quintic import PhQuintic
from tests.kinematics.ph_golden import GOLDEN, MM, curvature, hermite

Z = (0.0, 0.0, 1.0)


def vec(values: list[float], scale: float = 1.0) -> tuple[float, float, float]:
    x, y, z = (v * scale for v in values)
    return (x, y, z)


def matches(curve: PhQuintic, golden: dict[str, Any], scale: float = MM) -> None:
    np.testing.assert_allclose(
        curve.control_points_m / scale, golden["CP"], rtol=0, atol=2e-12 / min(scale, 1.0) * MM
    )
    np.testing.assert_allclose(curve.length_m / scale, golden["S"], rtol=3e-15)
    np.testing.assert_allclose(curve.bending_energy * scale, golden["Eb"], rtol=1e-12)
    np.testing.assert_allclose(curve.twist_energy * scale, golden["Et"], rtol=1e-11, atol=1e-15)
    assert np.abs(curve.preimage) / np.sqrt(scale) == pytest.approx(np.abs(np.array(golden["A"])), abs=1e-11)


def test_ph1_prescribed_length() -> None:
    golden = GOLDEN["ph_len230"]
    fit = through(CurveEnds((0, 0, 0), vec(golden["p1"], MM), Z, vec(golden["t1"])), 0.230)
    assert fit.length_met
    assert fit.end_speed_m / MM == pytest.approx(golden["m"], rel=1e-13)
    matches(fit.curve, golden)
    t = fit.curve.parameter_at(np.array([0.115]))
    assert t == pytest.approx(0.498972928959, abs=1e-12)
    assert fit.curve.point(t)[0] / MM == pytest.approx(
        [-19.0303238609, 12.8170435029, 111.9638912752], abs=1e-9
    )
    assert curvature(fit.curve, t) * MM == pytest.approx(0.003228116756, abs=1e-12)


def test_ph2_unknown_length() -> None:
    golden, posture = GOLDEN["ph_selfconsistent"], GOLDEN["ph_len230"]
    fit = through(CurveEnds((0, 0, 0), vec(posture["p1"], MM), Z, vec(posture["t1"])))
    assert fit.end_speed_m == pytest.approx(fit.curve.length_m, rel=1e-14)
    assert fit.end_speed_m / MM == pytest.approx(229.629260101439, abs=1e-11)
    matches(fit.curve, golden)


@pytest.mark.parametrize(
    ("name", "beta", "gamma"), [("ph_c1_b0_g0", 0.0, 0.0), ("ph_c1_b03_g-02", 0.3, -0.2)]
)
def test_ph3_and_ph4_hermite(name: str, beta: float, gamma: float) -> None:
    curve = hermite(np.zeros(3), np.ones(3), np.array([1.0, 0, 1]), np.array([0, 1.0, 1]), beta, gamma)
    matches(curve, GOLDEN[name], scale=1.0)


def arc(angle: float, length: float = 0.2) -> tuple[CurveEnds, np.ndarray]:
    """Ends of a circular arc in x-z that starts along z, and 101 of its points."""
    theta = np.linspace(0.0, angle, 101)
    r = length / angle
    points = np.stack([r * (1 - np.cos(theta)), np.zeros(101), r * np.sin(theta)], axis=-1)
    direction = (float(np.sin(angle)), 0.0, float(np.cos(angle)))
    return CurveEnds((0, 0, 0), vec(points[-1].tolist()), Z, direction), points


def test_ph5_quarter_circle() -> None:
    ends, _ = arc(np.pi / 2)
    fit = through(ends, 0.2)
    assert fit.end_speed_m / MM == pytest.approx(204.204831194232, abs=1e-11)
    matches(fit.curve, GOLDEN["ph_quarter"])


def test_ph6_more_than_half_a_turn() -> None:
    ends, _ = arc(1.5 * np.pi)
    fit = least_energy(ends, 0.2)
    assert np.array_equal(fit.curve.preimage, through(ends, 0.2, beta=np.pi).curve.preimage)
    assert fit.end_speed_m / MM == pytest.approx(245.993245060333, abs=1e-10)
    matches(fit.curve, GOLDEN["ph_270deg_beta_pi"])


# Greatest error at equal arc-length fraction, % of the length: reference E.3, first and second column.
KNOWN = {30: 5e-5, 60: 2.5e-4, 90: 0.00165, 120: 0.00695, 150: 0.02155, 180: 0.05475}
KNOWN |= {210: 0.1215, 240: 0.2435, 270: 0.4535, 300: 0.7985, 330: 1.345}
UNKNOWN = {30: (0.00945, -0.0035), 60: (0.0785, -0.0435), 90: (0.285, -0.235)}
UNKNOWN |= {120: (0.705, -0.765), 150: (1.505, -2.05), 180: (2.865, -4.55)}


@pytest.mark.parametrize("degrees", KNOWN)
def test_arcs_with_known_length(degrees: int) -> None:
    ends, points = arc(np.radians(degrees), 0.23)
    fit = least_energy(ends, 0.23)
    assert fit.curve.length_m == pytest.approx(0.23, rel=3e-15)
    error = np.linalg.norm(fit.curve.evenly(101) - points, axis=1).max() / 0.23 * 100
    assert error <= KNOWN[degrees]


@pytest.mark.parametrize("degrees", UNKNOWN)
def test_arcs_with_unknown_length(degrees: int) -> None:
    ends, points = arc(np.radians(degrees), 0.23)
    curve = through(ends).curve
    shape, length = UNKNOWN[degrees]
    assert np.linalg.norm(curve.evenly(101) - points, axis=1).max() / 0.23 * 100 <= shape
    assert length <= (curve.length_m / 0.23 - 1) * 100 <= 0.0


def test_exact_half_turn_bends_towards_its_chord() -> None:
    ends = CurveEnds((0, 0, 0), (0.1, 0.0, 0.0), Z, (0.0, 0.0, -1.0))
    curve = through(ends, 0.05 * np.pi).curve
    _, points = arc(np.pi, 0.05 * np.pi)
    assert np.linalg.norm(curve.evenly(101) - points, axis=1).max() < 0.0006 * curve.length_m


component = st.floats(-1.0, 1.0)
vectors = st.tuples(component, component, component).filter(lambda v: np.linalg.norm(v) > 0.05)
lengths = st.floats(1.05, 2.5)


@settings(max_examples=40, deadline=None)
@given(vectors, vectors, vectors, st.sampled_from(BRANCHES), lengths)
def test_ends_length_and_quadrature(chord, t0, t1, branch, surplus) -> None:
    """End data are met, the closed length is the quadrature of the speed, a prescribed one is met."""
    ends = CurveEnds((0.3, -0.2, 0.1), vec((np.array([0.3, -0.2, 0.1]) + chord).tolist()), t0, t1)
    length_m = surplus * float(np.linalg.norm(chord))
    for length in (None, length_m):
        fit = through(ends, length, *branch)
        curve, m = fit.curve, fit.end_speed_m
        assert curve.control_points_m[-1] == pytest.approx(np.array(ends.end_m), abs=2e-13 * max(1.0, m))
        both = curve.tangent(np.array([0.0, 1.0]))
        assert both[0] == pytest.approx(np.array(t0) / np.linalg.norm(t0), abs=1e-14)
        assert both[1] == pytest.approx(np.array(t1) / np.linalg.norm(t1), abs=1e-14)
        assert curve.speed(np.array([0.0, 1.0])) == pytest.approx([m, m], rel=1e-13)
        # Ten Gauss points integrate the quartic speed exactly: what is left is rounding.
        nodes, weights = np.polynomial.legendre.leggauss(10)
        assert curve.length_m == pytest.approx(0.5 * weights @ curve.speed(0.5 * (nodes + 1)), rel=1e-14)
        if length is not None and fit.length_met:
            assert curve.length_m == pytest.approx(length_m, rel=1e-13)
        if length is None:
            assert curve.length_m == pytest.approx(m, rel=1e-13)


@settings(max_examples=40, deadline=None)
@given(vectors, vectors, vectors, st.integers(0, 2**32 - 1), st.sampled_from(BRANCHES))
def test_turning_the_ends_turns_the_curve(chord, t0, t1, seed, branch) -> None:
    R = Rotation.random(random_state=np.random.RandomState(seed)).as_matrix()
    plain = through(CurveEnds((0, 0, 0), chord, t0, t1), None, *branch).curve
    ends = CurveEnds((0, 0, 0), vec((R @ chord).tolist()), vec((R @ t0).tolist()), vec((R @ t1).tolist()))
    # Opposite or (for beta = pi) equal tangents and straight data leave the plane open: nothing to turn.
    n0, n1, n = (np.array(v) / np.linalg.norm(v) for v in (t0, t1, chord))
    spread = np.linalg.svd(np.stack([n0, n1, n]), compute_uv=False)
    if min(np.linalg.norm(n0 + n1), np.linalg.norm(n0 - n1), spread[1]) > 1e-3:
        turned_curve = through(ends, None, *branch).curve
        assert turned_curve.control_points_m == pytest.approx(plain.control_points_m @ R.T, abs=1e-10)


@settings(max_examples=40, deadline=None)
@given(vectors, vectors, vectors)
def test_swapping_the_ends_gives_the_same_curve(chord, t0, t1) -> None:
    minus = [tuple(-np.array(v)) for v in (t1, t0)]
    there = through(CurveEnds((0, 0, 0), chord, t0, t1)).curve
    back = through(CurveEnds(chord, (0, 0, 0), *minus)).curve
    if np.linalg.norm(np.array(t0) / np.linalg.norm(t0) + np.array(t1) / np.linalg.norm(t1)) > 1e-3:
        assert back.control_points_m[::-1] == pytest.approx(there.control_points_m, abs=1e-11)


def test_curvature_and_arc_length_against_derivatives() -> None:
    curve = hermite(np.zeros(3), np.ones(3), np.array([1.0, 0, 1]), np.array([0, 1.0, 1]), 0.3, -0.2)
    t = np.linspace(0.05, 0.95, 19)
    h = 1e-5
    plus, minus, here = curve.point(t + h), curve.point(t - h), curve.point(t)
    velocity, acceleration = (plus - minus) / (2 * h), (plus - 2 * here + minus) / h**2
    numeric = np.linalg.norm(np.cross(velocity, acceleration), axis=1) / np.linalg.norm(velocity, axis=1) ** 3
    assert curvature(curve, t) == pytest.approx(numeric, rel=1e-5)
    assert curve.arc_length(t)[-1] == pytest.approx(
        quad(lambda x: curve.speed(np.array([x]))[0], 0, t[-1])[0]
    )
    assert curve.parameter_at(curve.arc_length(t)) == pytest.approx(t, abs=1e-14)


@pytest.mark.parametrize("tiny", [0.0, 1e-300, 1e-17, 1e-12, 1e-9, 1e-3])
def test_lift_is_exact_next_to_its_singularity(tiny: float) -> None:
    vector = np.array([-np.sqrt(1 - tiny**2), tiny * 0.6, tiny * 0.8])
    preimage = lift(vector)
    assert product(preimage, preimage) == pytest.approx(vector, abs=1e-15)
    again = turned(preimage, np.cos(0.7), np.sin(0.7))
    assert product(again, again) == pytest.approx(vector, abs=1e-15)


def test_straight_body_of_its_own_length() -> None:
    for bend in (0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3):
        ends, points = (
            arc(max(bend, 1e-300), 0.2) if bend else (CurveEnds((0, 0, 0), (0, 0, 0.2), Z, Z), None)
        )
        fit = through(ends, 0.2)
        assert fit.length_met
        assert fit.curve.length_m == pytest.approx(0.2, rel=1e-9)
        assert fit.end_speed_m == pytest.approx(0.2, rel=0.02)
        if points is not None:
            assert fit.curve.evenly(101) == pytest.approx(points, abs=1e-9)


@pytest.mark.parametrize("off", [1e-6, 1e-9, 1e-12, 1e-14])
def test_nearly_opposite_directions_keep_the_prescribed_length(off: float) -> None:
    """The turn of the end preimage hangs on the digits of ``t0 + t1``; the length must not."""
    direction = np.array([-0.165, 0.404, 0.899])
    direction /= np.linalg.norm(direction)
    across = np.array([0.3, -0.5, 0.8])
    ends = CurveEnds((0.0, 0.0, 0.0), (-0.87, 1.05, -1.13), tuple(direction), tuple(off * across - direction))
    for fit in (through(ends, 3.456), least_energy(ends, 3.456)):
        assert fit.length_met
        assert fit.curve.length_m == pytest.approx(3.456, rel=1e-14)


def test_a_length_shorter_than_the_chord_is_reported() -> None:
    fit = through(CurveEnds((0, 0, 0), (0, 0, 0.2), Z, Z), 0.19)
    assert not fit.length_met
    assert "10 mm shorter" in fit.note
    assert fit.curve.length_m == pytest.approx(0.2)


def test_a_curve_back_to_its_own_start_needs_a_length() -> None:
    along, back = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
    for direction in (along, back):
        ends = CurveEnds((0.1, 0.2, 0.3), (0.1, 0.2, 0.3), along, direction)
        with pytest.raises(ValueError, match="both ends of the curve are one point"):
            through(ends)
        assert through(ends, 0.3).curve.length_m == pytest.approx(0.3)
