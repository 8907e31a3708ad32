"""The compiled curves: what a quintic through given ends must fulfil, and tubes drawn as offset curves.

A quintic is known by its preimage A(t): its hodograph A i A* is integrated here by Gauss quadrature, and the
turns of its ends and middle are measured in the plane of A and A i. Tubes are drawn point by point.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from contid.kernels import load
from contid_ropes.ph.ends import BRANCHES, CurveEnds, PhFit, least_energy, plausible_energy, through
from contid_ropes.ph.model import ShapeInverse, TubeSection
from contid_ropes.ph.quintic import PhQuintic
from tests.kinematics.ph_golden import DISTANCE, GOLDEN, MM, PAPER_ANGLES, golden_lengths, two_section_pose
from tests.oracles.offset_curves import tube_length

kernel: Any = load("ph_curve")
SECTIONS = [TubeSection(float(d), tuple(PAPER_ANGLES.tolist())) for d in DISTANCE]
SPLIT = (125 / 240, 115 / 240)
#: Exact for polynomials of degree nine.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(5)


def hodograph(preimage: np.ndarray, t: np.ndarray) -> np.ndarray:
    """``A i A*`` at parameters, ``(n, 3)``: quaternion products written out."""
    a = (
        np.outer((1 - t) ** 2, preimage[0])
        + np.outer(2 * t * (1 - t), preimage[1])
        + np.outer(t**2, preimage[2])
    )
    w, x, y, z = a.T
    return np.stack((w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)), axis=1)


def random_ends(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    chord, t0, t1 = rng.normal(size=(3, 3))
    return chord, t0 / np.linalg.norm(t0), t1 / np.linalg.norm(t1)


def test_a_curve_has_its_ends_its_directions_and_its_length() -> None:
    rng = np.random.default_rng(7)
    met = 0
    for _ in range(200):
        chord, t0, t1 = random_ends(rng)
        length = math.nan if rng.random() < 0.4 else float(np.linalg.norm(chord) * rng.uniform(1.02, 2.5))
        beta, gamma = BRANCHES[rng.integers(4)]
        fit = kernel.through(*chord, list(t0), list(t1), length, beta, gamma)
        A = np.array(fit.preimage).reshape(3, 4)
        t = 0.5 * (NODES + 1.0)
        ends = hodograph(A, np.array([0.0, 1.0]))
        m = fit.end_speed_m
        np.testing.assert_allclose(0.5 * WEIGHTS @ hodograph(A, t), chord, atol=1e-12 * max(1.0, m))
        np.testing.assert_allclose(ends, m * np.stack((t0, t1)), atol=1e-12 * m)
        speed = np.linalg.norm(hodograph(A, t), axis=1)
        assert 0.5 * WEIGHTS @ speed == pytest.approx(fit.length_m, rel=1e-12)
        if math.isnan(length):
            assert fit.length_met
            assert fit.length_m == pytest.approx(m, rel=1e-10)
        elif fit.length_met:
            met += 1
            assert fit.length_m == pytest.approx(length, rel=1e-10)
        else:
            assert fit.length_m == pytest.approx(m, rel=1e-10)  # as of unknown length
    assert met > 50


def test_the_branches_are_those_of_the_curves_that_are_drawn() -> None:
    """`contid_ropes.ph.ends` draws ropes and bodies; its golden values are the reference's."""
    rng = np.random.default_rng(8)
    for _ in range(150):
        chord, t0, t1 = random_ends(rng)
        beta, gamma = rng.uniform(-3.0, 3.0, 2) if rng.random() < 0.5 else BRANCHES[rng.integers(4)]
        length = None if rng.random() < 0.4 else float(np.linalg.norm(chord) * rng.uniform(0.9, 2.5))
        drawn = through(CurveEnds((0, 0, 0), tuple(chord), tuple(t0), tuple(t1)), length, beta, gamma)
        fit = kernel.through(*chord, list(t0), list(t1), math.nan if length is None else length, beta, gamma)
        assert fit.length_met is drawn.length_met
        assert fit.end_speed_m == pytest.approx(drawn.end_speed_m, rel=1e-10)
        scale = 1e-8 * math.sqrt(fit.end_speed_m)
        assert np.array(fit.preimage).reshape(3, 4) == pytest.approx(drawn.curve.preimage, abs=scale)


@pytest.mark.parametrize("tiny", [0.0, 1e-300, 1e-17, 1e-9, 1e-3])
def test_directions_next_to_the_singular_one(tiny: float) -> None:
    """Tangents along -x have no preimage near that of +x; half turns leave the turn to the chord."""
    back = (-math.sqrt(1.0 - tiny * tiny), 0.6 * tiny, 0.8 * tiny)
    for t0, t1 in ((back, (0.0, 0.0, 1.0)), ((0.0, 0.0, 1.0), back), (back, back), ((1.0, 0.0, 0.0), back)):
        fit = kernel.through(0.1, 0.2, 0.3, t0, t1, 0.6, 0.0, 0.0)
        A = np.array(fit.preimage).reshape(3, 4)
        ends = hodograph(A, np.array([0.0, 1.0]))
        np.testing.assert_allclose(ends, fit.end_speed_m * np.array((t0, t1)), atol=1e-14)
        reached = 0.5 * WEIGHTS @ hodograph(A, 0.5 * (NODES + 1.0))
        np.testing.assert_allclose(reached, (0.1, 0.2, 0.3), atol=1e-13)


def test_a_straight_curve_of_its_own_length() -> None:
    fit = kernel.through(0.0, 0.0, 0.2, (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 0.2)
    assert fit.length_met
    assert fit.length_m == pytest.approx(0.2, rel=1e-12)
    assert fit.end_speed_m == pytest.approx(0.2, rel=1e-12)
    short = kernel.through(0.0, 0.0, 0.2, (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 0.19)
    assert not short.length_met
    assert short.length_m == pytest.approx(0.2, rel=1e-12)


def test_the_lowest_point_is_the_lowest_of_the_samples() -> None:
    rng = np.random.default_rng(9)
    for samples in (2, 17, 129):
        for _ in range(40):
            chord, t0, t1 = random_ends(rng)
            length = float(np.linalg.norm(chord) * rng.uniform(1.02, 1.8))
            fit = kernel.through(*chord, list(t0), list(t1), length)
            curve = PhQuintic(np.zeros(3), np.array(fit.preimage).reshape(3, 4))
            points = curve.point(np.linspace(0.0, 1.0, samples))
            found = kernel.lowest(*chord, *t0, *t1, length, samples)
            assert found == pytest.approx(points[np.argmin(points[:, 2])], abs=1e-12)
    with pytest.raises(ValueError, match="two samples"):
        kernel.lowest(*chord, *t0, *t1, 1.0, 1)


def fitted(tip: Any, direction: Any, length: float | None) -> PhFit:
    """The curve that stands for an arm; a length that would fold it is ignored (see `plausible_energy`)."""
    ends = CurveEnds((0.0, 0.0, 0.0), tuple(tip), (0.0, 0.0, 1.0), tuple(direction))
    free = through(ends)
    if length is None:
        return free
    most = plausible_energy(free, length)
    for fit in (through(ends, length), least_energy(ends, length)):
        if fit.length_met and fit.energy_per_m <= most:
            return fit
    return free


def test_tubes_are_offset_curves() -> None:
    arm = ShapeInverse(SECTIONS, SPLIT)
    for row in golden_lengths()[::54]:
        tip, tangent, _ = two_section_pose(row)
        for length in (None, float(row[:3].mean() + row[3:].mean())):
            found = arm.solve(tuple(tip.tolist()), tuple(tangent.tolist()), length)
            curve = fitted(tip, tangent, length).curve
            joints = curve.length_m * np.array((0.0, SPLIT[0], 1.0))
            drawn = [
                tube_length(curve, joints[s], joints[s + 1], section.distance_m, angle)
                for s, section in enumerate(SECTIONS)
                for angle in section.angles_rad
            ]
            assert found.lengths_m == pytest.approx(drawn, abs=2e-8)
            assert found.length_met


@pytest.mark.parametrize(("length", "name"), [(0.230, "S230"), (None, "Sunknown")])
def test_golden_lengths(length: float | None, name: str) -> None:
    ratio, posture = GOLDEN["ph_ik"]["ratio"], GOLDEN["ph_len230"]
    arm = ShapeInverse(SECTIONS, (ratio, 1 - ratio))
    found = arm.solve(tuple(np.array(posture["p1"]) * MM), tuple(posture["t1"]), length)
    # 8 panels agree with the converged value to 8 decimals of a millimetre.
    assert np.array(found.lengths_m) / MM == pytest.approx(GOLDEN["ph_ik"][name], abs=2e-8)
    if length:
        assert np.reshape(found.lengths_m, (2, 3)).sum(axis=0) / MM == pytest.approx(
            [204.99937965, 245.42807943, 239.57254092], abs=2e-8
        )


def test_rows_are_the_single_calls() -> None:
    truth = golden_lengths(12)
    poses = np.array([np.concatenate([*two_section_pose(row)[:2], [math.nan]]) for row in truth])
    poses[::2, 6] = 0.24
    arm = kernel.ShapeInverse(DISTANCE.tolist(), [PAPER_ANGLES.tolist()] * 2, list(SPLIT))
    out = np.empty((12, 6))
    arm.solve_rows(poses, out)
    assert [tuple(row) for row in out.tolist()] == [arm.solve(*pose).lengths_m for pose in poses.tolist()]


def test_wrong_shapes_are_refused() -> None:
    three = [0.0, 2.0, 4.0]
    for given in (
        ([0.04], [], [1.0]),
        ([], [], []),
        ([0.04] * 9, [three] * 9, [0.1] * 9),
        ([0.04], [three], []),
    ):
        with pytest.raises(ValueError, match="1 to 8 sections"):
            kernel.ShapeInverse(*given)
    with pytest.raises(ValueError, match="1 to 8 sections"):
        kernel.ShapeInverse([0.04], [[0.0] * 9], [1.0])
    assert kernel.ShapeInverse([0.04] * 8, [[0.0] * 8] * 8, [0.125] * 8)
    with pytest.raises(ValueError, match="same number of tubes"):
        kernel.ShapeInverse([0.04, 0.04], [three, three[:2]], [0.5, 0.5])
    arm = kernel.ShapeInverse([0.04], [three], [1.0])
    for poses, out in (((2, 6), (2, 3)), ((2, 7), (2, 4)), ((2, 7), (3, 3))):
        with pytest.raises(ValueError, match="poses are"):
            arm.solve_rows(np.zeros(poses), np.zeros(out))
    for ends in (((0.0, 1.0), three), (three, (0.0, 1.0))):
        with pytest.raises(ValueError, match="three components"):
            kernel.through(0.0, 0.0, 1.0, *ends)


def test_nearly_straight_arms_with_noise_and_a_stated_length() -> None:
    """A length a hundredth too long is not folded into a loop."""
    rng = np.random.default_rng(41)
    arm = ShapeInverse(SECTIONS, SPLIT)
    accepted = 0
    for _ in range(150):
        backbone = rng.uniform(0.2, 0.28)
        # 1 mm and 1 degree of noise about the straight arm, the length known to a hundredth.
        tip = tuple((np.array([0.0, 0.0, backbone]) + 1e-3 * rng.standard_normal(3)).tolist())
        direction = tuple(np.array([*np.radians(rng.standard_normal(2)), 1.0]).tolist())
        length = float(backbone * (1.0 + rng.uniform(-0.005, 0.015)))
        found = arm.solve(tip, direction, length)
        curve = fitted(tip, direction, length).curve
        assert found.length_met is (abs(curve.length_m - length) < 1e-9)
        backbones = np.reshape(found.lengths_m, (2, 3)).mean(axis=1)
        assert backbones.sum() == pytest.approx(curve.length_m, abs=1e-12)
        accepted += found.length_met
        assert np.abs(np.reshape(found.lengths_m, (2, 3)).sum(axis=0) - backbone).max() < 0.012
    assert 0 < accepted < 150
