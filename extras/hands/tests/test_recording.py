"""Recorded motions: what a hand did comes back, inside the limits and the rates; noise does not."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from contid.errors import ContidError, RecordingStoppedError
from contid.remote.client.described_robot import DescribedRobot
from contid_hands.teach import recording
from contid_hands.teach.recording import RecordedLimits, taught_motion
from contid_hands.teach.teacher import Teacher

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


def test_a_motion_that_cannot_be_written_is_kept_until_it_can(tmp_path: Path) -> None:
    """The folder of the pose file is gone, and comes back: as a full disk that a person makes room on."""
    robot_file = tmp_path / "arm.yaml"
    robot_file.write_text("x")
    limits = ((60.0, 1000.0, 20000.0),) * 2
    arm = DescribedRobot(
        robot="arm", axes=("a_mm", "b_mm"), minimum=(0.0, 0.0), maximum=(100.0, 100.0), tip=(), bends=(),
        unit="mm", units=("mm", "mm"), rates=limits[0], axis_rates=limits, estop="relax",
    )  # fmt: skip
    lines: list[str] = []
    teacher = Teacher([arm], tmp_path / "away" / "arm.poses.yaml", robot_file, 20.0, lines.append)
    times_s = np.arange(0.0, 3.0, 0.02)
    teacher.press("r")
    for time_s, values in zip(times_s, hand(times_s, 1.0), strict=True):
        teacher.take({"t_s": time_s, "robots": {"arm": {"measured": values.tolist()}}})
    teacher.press("r")
    assert teacher.recording
    assert lines[-1].endswith("the recording goes on, r ends it")
    with pytest.raises(RecordingStoppedError, match="a motion of 150 samples is lost"):
        teacher.close()
    (tmp_path / "away").mkdir()
    teacher.press("r")
    assert (tmp_path / "away" / "motion1.csv").exists()
    teacher.close()
