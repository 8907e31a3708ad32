"""Recorded motions: what a hand did comes back, inside the limits and the rates; noise does not."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from contid.errors import ContidError
from contid_hands.teach import recording
from contid_hands.teach.recording import RecordedLimits, taught_motion

LIMITS = RecordedLimits(np.zeros(2), np.full(2, 100.0), np.array([[60.0] * 2, [1000.0] * 2, [20000.0] * 2]))


def hand(times_s: np.ndarray, duration_s: float) -> np.ndarray:
    """One axis to and fro, the other one way; still before and after."""
    s = np.clip((times_s - 1.0) / duration_s, 0.0, 1.0)
    smooth = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
    return np.column_stack([50.0 + 20.0 * np.sin(np.pi * smooth), 30.0 + 40.0 * smooth])


@pytest.mark.parametrize("duration_s", [0.8, 3.0])
def test_a_noisy_motion_comes_back_smooth_within_the_rates(duration_s: float) -> None:
    random = np.random.default_rng(1)
    times_s = np.cumsum(random.uniform(0.01, 0.03, 400))  # uneven telemetry
    clean = hand(times_s, duration_s)
    motion = taught_motion(times_s, clean + random.normal(0.0, 0.02, clean.shape), LIMITS, 20.0)
    assert motion.rows[0] == pytest.approx(clean[0], abs=0.3)
    assert motion.rows[-1] == pytest.approx(clean[-1], abs=0.3)
    assert (motion.slower > 1.0) == (duration_s < 1.0)
    # Another interpolation than the one that made it: the rates of the robot file are kept.
    curve = CubicSpline(motion.times_s, motion.rows)
    dense = np.linspace(0.0, motion.times_s[-1], 5000)
    for order in (1, 2):
        assert np.abs(curve(dense, order)).max() < LIMITS.rates[order - 1].min()
    # The path: every measured pose is near the taught one.
    path = curve(dense)
    near = np.array([np.hypot(*(path - pose).T).min() for pose in clean])
    assert near.max() < (0.5 if duration_s > 1.0 else 1.5)
    # The standstill before and after is cut to a margin.
    assert motion.times_s[-1] / motion.slower < duration_s + 1.0


def test_samples_outside_the_limits_are_moved_to_them() -> None:
    times_s = np.arange(0.0, 3.0, 0.02)
    samples = np.column_stack([np.linspace(90.0, 110.0, len(times_s)), np.full(len(times_s), 50.0)])
    motion = taught_motion(times_s, samples, LIMITS, 20.0)
    assert np.max(motion.rows) <= 100.0
    assert motion.clipped == int((samples > 100.0).any(axis=1).sum())


def test_a_recording_needs_no_package_beyond_the_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without SciPy the motion would be lost at its end; with it the filter is the same."""
    times_s = np.arange(0.0, 3.0, 0.02)
    noisy = hand(times_s, 1.0) + np.random.default_rng(2).normal(0.0, 0.5, (len(times_s), 2))
    filtered = recording._smoothed(noisy, 10.0)
    assert filtered == pytest.approx(gaussian_filter1d(noisy, 10.0, axis=0, mode="nearest"), abs=1e-12)
    for name in [each for each in sys.modules if each.partition(".")[0] == "scipy"]:
        monkeypatch.setitem(sys.modules, name, None)
    assert len(taught_motion(times_s, noisy, LIMITS, 20.0).rows) > 20


def test_no_motion_is_no_recording() -> None:
    times_s = np.arange(0.0, 3.0, 0.02)
    with pytest.raises(ContidError, match="nothing moved while it was recorded; is the torque off"):
        taught_motion(times_s, np.full((len(times_s), 2), 50.0), LIMITS, 20.0)
    with pytest.raises(ContidError, match="0 samples; a motion needs at least 5"):
        taught_motion(np.zeros(0), np.zeros((0, 2)), LIMITS, 20.0)
