"""The compiled PH curves against their NumPy specification."""

from __future__ import annotations

import numpy as np
import pytest

from contid.kernels import load
from contid.kinematics.ph.ends import BRANCHES, CurveEnds, through
from contid.kinematics.ph.inverse import ShapeInverse, TubeSection, ph_inverse
from tests.kinematics.ph_golden import DISTANCE, GOLDEN, MM, PAPER_ANGLES, golden_lengths, two_section_pose

kernel = load("ph_curve")
pytestmark = pytest.mark.skipif(
    kernel is None, reason="kernels are not compiled here (tests/build_kernels.sh)"
)

SECTIONS = [TubeSection(float(d), tuple(PAPER_ANGLES.tolist())) for d in DISTANCE]
SPLIT = (125 / 240, 115 / 240)


def test_lengths_on_the_golden_trajectory() -> None:
    arm = ShapeInverse(SECTIONS, SPLIT)
    assert arm.compiled
    for row in golden_lengths():
        tip, tangent, _ = (tuple(v.tolist()) for v in two_section_pose(row))
        for length in (None, float(row[:3].mean() + row[3:].mean())):
            fast, slow = arm.solve(tip, tangent, length), ph_inverse(tip, tangent, SECTIONS, SPLIT, length)
            assert fast.lengths_m == pytest.approx(slow.lengths_m, abs=1e-14)
            assert fast.length_met


def test_golden_row() -> None:
    ratio, posture = GOLDEN["ph_ik"]["ratio"], GOLDEN["ph_len230"]
    arm = ShapeInverse(SECTIONS, (ratio, 1 - ratio))
    found = arm.solve(tuple(np.array(posture["p1"]) * MM), tuple(posture["t1"]), 0.230)
    assert np.array(found.lengths_m) / MM == pytest.approx(GOLDEN["ph_ik"]["S230"], abs=2e-8)


def test_curves_on_wild_data() -> None:
    rng = np.random.default_rng(7)
    for _ in range(500):
        chord, t0, t1 = rng.normal(size=(3, 3))
        t0, t1 = t0 / np.linalg.norm(t0), t1 / np.linalg.norm(t1)
        beta, gamma = BRANCHES[rng.integers(4)]
        length = None if rng.random() < 0.4 else float(np.linalg.norm(chord) * rng.uniform(0.9, 2.5))
        slow = through(CurveEnds((0, 0, 0), tuple(chord), tuple(t0), tuple(t1)), length, beta, gamma)
        m, S, met, preimage = kernel.through(  # type: ignore[union-attr]
            *chord, list(t0), list(t1), np.nan if length is None else length, beta, gamma
        )
        assert met is slow.length_met
        assert m == pytest.approx(slow.end_speed_m, rel=1e-10)
        assert pytest.approx(slow.curve.length_m, rel=1e-10) == S
        assert np.array(preimage).reshape(3, 4) == pytest.approx(slow.curve.preimage, abs=1e-8 * np.sqrt(m))


def test_rows_are_the_single_calls() -> None:
    truth = golden_lengths(12)
    poses = np.array([np.concatenate([*two_section_pose(row)[:2], [np.nan]]) for row in truth])
    arm = kernel.ShapeInverse(DISTANCE.tolist(), [PAPER_ANGLES.tolist()] * 2, list(SPLIT))  # type: ignore[union-attr]
    out = np.empty((12, 6))
    arm.solve_rows(poses, out)
    assert [tuple(row) for row in out.tolist()] == [arm.solve(*pose)[0] for pose in poses.tolist()]


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="1 to 8 sections"):
        kernel.ShapeInverse([0.04], [], [1.0])  # type: ignore[union-attr]
    arm = kernel.ShapeInverse([0.04], [[0.0, 2.0, 4.0]], [1.0])  # type: ignore[union-attr]
    with pytest.raises(ValueError, match="poses are"):
        arm.solve_rows(np.zeros((2, 6)), np.zeros((2, 3)))


def test_without_the_kernel_numpy_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CONTID_PURE_PYTHON", "1")
    arm = ShapeInverse(SECTIONS, SPLIT)
    assert not arm.compiled
    found = arm.solve((0.02, 0.01, 0.23), (0.1, 0.0, 0.99))
    monkeypatch.delenv("CONTID_PURE_PYTHON")
    compiled = ShapeInverse(SECTIONS, SPLIT).solve((0.02, 0.01, 0.23), (0.1, 0.0, 0.99))
    assert found.lengths_m == pytest.approx(compiled.lengths_m, abs=1e-14)


def test_nearly_straight_arms_with_noise_and_a_stated_length() -> None:
    """A length a hundredth too long is not folded into a loop; kernel and specification decide alike."""
    rng = np.random.default_rng(41)
    arm = ShapeInverse(SECTIONS, SPLIT)
    accepted = 0
    for _ in range(400):
        backbone = rng.uniform(0.2, 0.28)
        # 1 mm and 1 degree of noise about the straight arm, the length known to a hundredth.
        tip = tuple((np.array([0.0, 0.0, backbone]) + 1e-3 * rng.standard_normal(3)).tolist())
        direction = tuple(np.array([*np.radians(rng.standard_normal(2)), 1.0]).tolist())
        length = float(backbone * (1.0 + rng.uniform(-0.005, 0.015)))
        fast, slow = arm.solve(tip, direction, length), ph_inverse(tip, direction, SECTIONS, SPLIT, length)
        assert fast.length_met is slow.length_met
        assert fast.lengths_m == pytest.approx(slow.lengths_m, abs=1e-12)
        accepted += fast.length_met
        assert np.abs(np.reshape(fast.lengths_m, (2, 3)).sum(axis=0) - backbone).max() < 0.012
    assert 0 < accepted < 400
