"""The stop: limits are kept, every axis comes to rest with the others, from any state."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from contid.trajectory.approach import MotionError
from contid.trajectory.standstill import JerkLimitedStop, stopping

ACCELERATION, JERK = 1.0, 20.0
START = (0.05, 0.06)
speeds, pushes = st.floats(-0.3, 0.3), st.floats(-3.0, 3.0)
MAGNITUDES = st.just(0.0) | st.floats(1e-9, 1e9) | st.floats(-1e9, -1e-9)
#: Ties, standstill and the limit itself are the exceptional cases of every formula here.
SPEEDS, PUSHES = (-0.1, 0.0, 0.05, 0.1), (-1.25, -1.0, 0.0, 0.5, 1.0, 1.25)


def check(motion: JerkLimitedStop, velocity: tuple[float, ...], scale: float = 1.0) -> None:
    """It begins in the state asked for, rests at its end, and does not jump in between.

    Args:
        motion: the stop.
        velocity: at its beginning.
        scale: what a thousandth of a second of the fastest motion covers, for tolerances.
    """
    assert motion.at(0.0)[1] == velocity
    rest = (0.0,) * len(velocity)
    assert motion.at(motion.duration_s) == motion.at(motion.duration_s + 1) == (motion.goal, rest)
    before, speed = motion.at(motion.duration_s * (1 - 1e-9))
    assert np.allclose(before, motion.goal, rtol=0.0, atol=1e-9 * scale)
    assert np.allclose(speed, 0.0, rtol=0.0, atol=1e-7 * scale)


@settings(max_examples=200, deadline=None)
@given(velocity=st.tuples(speeds, speeds), acceleration=st.tuples(pushes, pushes))
@example(velocity=(0.0, 0.0), acceleration=(1.25, 1.25))
@example(velocity=(0.0, 0.0), acceleration=(1.2, 1.2))
def test_a_stop_ends_at_rest_from_any_state(
    velocity: tuple[float, float], acceleration: tuple[float, float]
) -> None:
    motion = stopping(START, velocity, acceleration, ACCELERATION, JERK)
    assert motion.at(0.0)[0] == START
    check(motion, velocity)


@settings(max_examples=60, deadline=None)
@given(velocity=st.tuples(speeds, speeds), acceleration=st.tuples(pushes, pushes))
def test_a_stop_keeps_its_limits_and_its_derivatives_agree(
    velocity: tuple[float, float], acceleration: tuple[float, float]
) -> None:
    motion = stopping(START, velocity, acceleration, ACCELERATION, JERK)
    step = 1e-4
    states = [motion.at(t) for t in np.arange(0.0, motion.duration_s + 2 * step, step)]
    position, speed = (np.array(each) for each in zip(*states, strict=True))
    push = np.diff(speed, axis=0) / step
    assert np.allclose(np.diff(position, axis=0) / step, (speed[1:] + speed[:-1]) / 2, atol=1e-6)
    assert np.all(np.abs(push) <= np.maximum(ACCELERATION, np.abs(acceleration)) + 1e-6)
    assert np.abs(np.diff(push, axis=0)).max(initial=0.0) <= JERK * step * (1 + 1e-6)


def test_ties_standstill_and_limits_are_stopped_like_everything_else() -> None:
    """Together takes as long as the slower one alone."""
    states = [*itertools.product(SPEEDS, PUSHES)]
    alone = {each: stopping((0.0,), each[:1], each[1:], ACCELERATION, JERK).duration_s for each in states}
    for first, second in itertools.product(states, repeat=2):
        velocity = (first[0], second[0])
        motion = stopping(START, velocity, (first[1], second[1]), ACCELERATION, JERK)
        check(motion, velocity)
        assert motion.duration_s == pytest.approx(max(alone[first], alone[second]), rel=1e-7)


@settings(max_examples=200, deadline=None)
@given(
    speed=MAGNITUDES,
    push=MAGNITUDES,
    ratio=st.floats(-1.0, 1.0).map(lambda ratio: round(ratio, 3)),
    most=st.floats(1e-6, 1e9),
    jerk=st.floats(1e-6, 1e12),
)
def test_no_unit_and_no_ratio_of_limits_is_without_a_stop(
    speed: float, push: float, ratio: float, most: float, jerk: float
) -> None:
    velocity = (speed, ratio * speed)
    motion = stopping((0.0, 0.0), velocity, (push, ratio * push), most, jerk)
    top = abs(speed) + abs(push) * (most + abs(push)) / jerk
    check(motion, velocity, scale=(1.0 + motion.duration_s) * top)


def test_a_stop_from_standing_acceleration_has_the_textbook_length() -> None:
    """T = v / a + a / j with a plateau, 2 sqrt(v / j) without; the way is v T / 2."""
    long = stopping((0.0,), (0.1,), (0.0,), ACCELERATION, JERK)
    assert long.duration_s == pytest.approx(0.1 / ACCELERATION + ACCELERATION / JERK, rel=1e-12)
    assert long.goal[0] == pytest.approx(0.1 * long.duration_s / 2, rel=1e-12)
    short = stopping((0.0,), (-0.02,), (0.0,), ACCELERATION, JERK)
    assert short.duration_s == pytest.approx(2 * np.sqrt(0.02 / JERK), rel=1e-12)
    assert short.goal[0] == pytest.approx(-0.02 * short.duration_s / 2, rel=1e-12)


def test_a_slower_axis_takes_the_time_of_the_faster_one() -> None:
    motion = stopping((0.0, 0.0), (0.1, 0.01), (0.0, 0.0), ACCELERATION, JERK)
    for part in (0.5, 0.9, 0.99):
        assert all(speed > 0.0 for speed in motion.at(part * motion.duration_s)[1])
    assert motion.goal[1] == pytest.approx(0.01 * motion.duration_s / 2, rel=1e-12)


def test_a_robot_at_rest_stops_at_once() -> None:
    motion = stopping(START, (0.0, 0.0), (0.0, 0.0), ACCELERATION, JERK)
    assert motion.duration_s == 0.0
    assert motion.at(0.0) == (START, (0.0, 0.0))


def test_mirrored_states_have_mirrored_stops() -> None:
    there = stopping((0.02,), (0.1,), (-0.4,), ACCELERATION, JERK)
    back = stopping((-0.02,), (-0.1,), (0.4,), ACCELERATION, JERK)
    assert there.duration_s == back.duration_s
    assert there.goal == (-back.goal[0],)


def test_numbers_and_limits_that_are_none_are_refused() -> None:
    with pytest.raises(MotionError, match="must be finite"):
        stopping((0.0,), (float("inf"),), (0.0,), 1.0, 1.0)
    with pytest.raises(MotionError, match="must be positive"):
        stopping((0.0,), (1.0,), (0.0,), 1.0, float("nan"))
