"""Motions of axes whose limits differ: as fast as ruckig's from rest, within the limits from motion."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.trajectory.approach import Approach
from contid.trajectory.cruise import CruiseAxis, CruiseMotion, StraightMotion

pytestmark = pytest.mark.process

places = st.floats(-5.0, 5.0).map(lambda value: round(value, 6))
speeds = st.floats(-1.0, 1.0).map(lambda value: round(value, 6))
limits = st.tuples(st.floats(0.3, 30.0), st.floats(1.0, 900.0))
axes_at_rest = st.lists(st.tuples(places, st.just(0.0), places, limits), min_size=1, max_size=4)
moving_axes = st.lists(st.tuples(places, speeds, places, limits), min_size=1, max_size=4)


def motion_of(axes: list[tuple[float, float, float, tuple[float, float]]]) -> CruiseMotion:
    return CruiseMotion([CruiseAxis(start, u, goal, 1.0, *pair) for start, u, goal, pair in axes])


def approach_of(axes: list[tuple[float, float, float, tuple[float, float]]]) -> Approach:
    start, velocity, goal, pairs = zip(*axes, strict=True)
    accelerations, jerks = zip(*pairs, strict=True)
    return Approach(start, velocity, goal, (1.0,) * len(axes), accelerations, jerks)


@settings(max_examples=75, deadline=None)
@given(axes=axes_at_rest)
def test_from_standstill_it_takes_as_long_as_ruckig(
    axes: list[tuple[float, float, float, tuple[float, float]]],
) -> None:
    best = approach_of(axes)
    assert motion_of(axes).duration == pytest.approx(best.duration_s, rel=1e-5, abs=1e-9)


@settings(max_examples=75, deadline=None)
@given(axes=moving_axes)
def test_from_any_velocity_it_ends_at_the_goal_within_the_limits(
    axes: list[tuple[float, float, float, tuple[float, float]]],
) -> None:
    """Velocity and position are those of the integrated jerk, which is within its limit in every piece."""
    motion = motion_of(axes)
    start, velocity, goal, _ = zip(*axes, strict=True)
    assert np.allclose(motion.at_time(0.0), (start, velocity), atol=1e-12)
    assert np.allclose(motion.at_time(motion.duration), (goal, [0.0] * len(axes)), atol=1e-12)
    for start_at, u, goal_at, (acceleration, jerk) in axes:
        knots = CruiseAxis(start_at, u, goal_at, 1.0, acceleration, jerk).knots(motion.duration)
        for one, following in pairwise(knots):
            lasts = following[0] - one[0]
            assert lasts >= 0.0
            assert abs(one[2]) <= 1.0 + 1e-9
            assert abs(one[3]) <= acceleration * (1.0 + 1e-9)
            assert abs(one[4]) <= jerk * (1.0 + 1e-9)
            position = one[1] + lasts * (one[2] + lasts * (one[3] / 2.0 + lasts * one[4] / 6.0))
            assert position == pytest.approx(following[1], abs=1e-9)
            assert one[2] + lasts * (one[3] + lasts * one[4] / 2.0) == pytest.approx(following[2], abs=1e-9)
            assert one[3] + lasts * one[4] == pytest.approx(following[3], abs=1e-6 * jerk + 1e-9)
        assert knots[-1][0] <= motion.duration * (1.0 + 1e-12)


@settings(max_examples=60, deadline=None)
@given(axes=moving_axes)
def test_a_motion_that_begins_in_motion_is_not_faster_than_the_optimum(
    axes: list[tuple[float, float, float, tuple[float, float]]],
) -> None:
    best = approach_of(axes)
    assert motion_of(axes).duration >= best.duration_s * (1.0 - 1e-5) - 1e-9


def test_a_straight_motion_stays_on_its_line_as_ruckigs_does() -> None:
    start, goal, most = [0.0, 1.0, 2.0], [0.5, 0.7, 2.0], [[1.0] * 3, [4.0] * 3, [50.0] * 3]
    motion = StraightMotion(start, goal, most)
    best = Approach(start, [0.0] * 3, goal, most[0], most[1], most[2], straight=True)
    assert motion.duration == pytest.approx(best.duration_s, rel=1e-6)
    for time_s in np.linspace(0.0, motion.duration, 50):
        position, velocity = motion.at_time(time_s)
        share = (position[0] - start[0]) / 0.5
        assert position == pytest.approx([0.5 * share, 1.0 - 0.3 * share, 2.0], abs=1e-12)
        expected = best.at(time_s)
        assert position == pytest.approx(list(expected[0]), abs=1e-6)
        assert velocity == pytest.approx(list(expected[1]), abs=1e-4)


def test_a_robot_moves_without_the_package_of_ruckig(tmp_path: Path) -> None:
    """Its motions are in the kernel: the first row is approached, and the rest pose."""
    (tmp_path / "ruckig.py").write_text("raise ImportError('hidden')")
    rows = "t_s,left_mm,right_mm\n0,60,70\n1,62,68\n"
    done = subprocess.run(
        [sys.executable, "-m", "contid", "run", "finger", "--virtual", "--on-end", "rest"],
        input=rows, capture_output=True, text=True, timeout=120, cwd=tmp_path,
        env={"PYTHONPATH": str(tmp_path), "PATH": "/usr/bin:/bin", "HOME": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
