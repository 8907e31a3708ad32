"""The stop: limits are kept, every axis comes to rest with the others, from any velocity."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.trajectory.standstill import JerkLimitedStop

ACCELERATION, JERK = 1.0, 20.0
START = (0.05, 0.06)
speeds = st.floats(-0.3, 0.3)
MAGNITUDES = st.just(0.0) | st.floats(1e-9, 1e9) | st.floats(-1e9, -1e-9)
#: Ties, standstill and the speed that just reaches the limit are the exceptional cases of every formula here.
SPEEDS = (-0.1, -0.05, -0.0, 0.0, 1e-6, 0.05, 0.1)


def stop(
    position: tuple[float, ...],
    velocity: tuple[float, ...],
    acceleration: float = ACCELERATION,
    jerk: float = JERK,
) -> JerkLimitedStop:
    """With the same limits for all axes."""
    return JerkLimitedStop(position, velocity, (acceleration,) * len(position), (jerk,) * len(position))


def end(motion: JerkLimitedStop) -> tuple[float, ...]:
    return motion.at(motion.duration_s)[0]


def check(motion: JerkLimitedStop, velocity: tuple[float, ...], scale: float = 1.0) -> None:
    """It begins in the state asked for, rests at its end, and does not jump in between.

    Args:
        motion: the stop.
        velocity: at its beginning.
        scale: what a thousandth of a second of the fastest motion covers, for tolerances.
    """
    rest = (0.0,) * len(velocity)
    assert motion.at(0.0)[1] == velocity
    assert motion.at(motion.duration_s) == motion.at(motion.duration_s + 1) == (end(motion), rest)
    before, speed = motion.at(motion.duration_s * (1 - 1e-9))
    assert np.allclose(before, end(motion), rtol=0.0, atol=1e-9 * scale)
    assert np.allclose(speed, 0.0, rtol=0.0, atol=1e-7 * scale)


@settings(max_examples=100, deadline=None)
@given(velocity=st.tuples(speeds, speeds))
def test_a_stop_ends_at_rest_from_any_velocity(velocity: tuple[float, float]) -> None:
    motion = stop(START, velocity)
    assert motion.at(0.0)[0] == START
    check(motion, velocity)


@settings(max_examples=25, deadline=None)
@given(velocity=st.tuples(speeds, speeds))
def test_a_stop_keeps_its_limits_and_its_derivatives_agree(velocity: tuple[float, float]) -> None:
    motion = stop(START, velocity)
    step = 1e-4
    states = [motion.at(t) for t in np.arange(0.0, motion.duration_s + 2 * step, step)]
    position, speed = (np.array(each) for each in zip(*states, strict=True))
    push = np.diff(speed, axis=0) / step
    assert np.allclose(np.diff(position, axis=0) / step, (speed[1:] + speed[:-1]) / 2, atol=1e-6)
    assert np.all(np.abs(push) <= ACCELERATION + 1e-6)
    assert np.abs(np.diff(push, axis=0)).max(initial=0.0) <= JERK * step * (1 + 1e-6)


@settings(max_examples=25, deadline=None)
@given(
    velocity=st.tuples(speeds, speeds),
    acceleration=st.tuples(st.floats(-ACCELERATION, ACCELERATION), st.floats(-ACCELERATION, ACCELERATION)),
)
def test_a_stop_goes_on_from_the_present_acceleration(
    velocity: tuple[float, float], acceleration: tuple[float, float]
) -> None:
    limits = (ACCELERATION,) * 2, (JERK,) * 2
    motion = JerkLimitedStop(START, velocity, *limits, acceleration)
    check(motion, velocity)
    step = 1e-4
    states = [motion.at(t) for t in np.arange(0.0, motion.duration_s + 2 * step, step)]
    position, speed = (np.array(each) for each in zip(*states, strict=True))
    push = np.diff(speed, axis=0) / step
    assert np.allclose(np.diff(position, axis=0) / step, (speed[1:] + speed[:-1]) / 2, atol=1e-6)
    assert np.all(np.abs(push) <= ACCELERATION + 1e-6)
    # The acceleration begins where it is, and changes by no more than the jerk, up to the rest.
    pushes = np.vstack((acceleration, push, (0.0, 0.0)))
    assert np.abs(np.diff(pushes, axis=0)).max() <= JERK * step * (1 + 1e-6)
    # No axis alone stops sooner: the acceleration has to go first, then the velocity that it leaves.
    for v, a in zip(velocity, acceleration, strict=True):
        left = abs(v + a * abs(a) / (2.0 * JERK))
        assert motion.duration_s >= left / ACCELERATION - 1e-9


def test_ties_standstill_and_limits_are_stopped_like_everything_else() -> None:
    """Together takes as long as the slower one alone."""
    alone = {each: stop((0.0,), (each,)).duration_s for each in SPEEDS}
    for velocity in itertools.product(SPEEDS, repeat=2):
        motion = stop(START, velocity)
        check(motion, velocity)
        assert motion.duration_s == pytest.approx(max(alone[each] for each in velocity), rel=1e-7)


@settings(max_examples=100, deadline=None)
@given(
    speed=MAGNITUDES,
    ratio=st.floats(-1.0, 1.0).map(lambda ratio: round(ratio, 3)),
    most=st.floats(1e-6, 1e9),
    jerk=st.floats(1e-6, 1e12),
)
def test_no_unit_and_no_ratio_of_limits_is_without_a_stop(
    speed: float, ratio: float, most: float, jerk: float
) -> None:
    velocity = (speed, ratio * speed)
    motion = stop((0.0, 0.0), velocity, most, jerk)
    check(motion, velocity, scale=(1.0 + motion.duration_s) * abs(speed))


def test_a_stop_has_the_textbook_length() -> None:
    """T = v / a + a / j with a plateau, 2 sqrt(v / j) without; the way is v T / 2."""
    long = stop((0.0,), (0.1,))
    assert long.duration_s == pytest.approx(0.1 / ACCELERATION + ACCELERATION / JERK, rel=1e-12)
    assert end(long)[0] == pytest.approx(0.1 * long.duration_s / 2, rel=1e-12)
    short = stop((0.0,), (-0.02,))
    assert short.duration_s == pytest.approx(2 * np.sqrt(0.02 / JERK), rel=1e-12)
    assert end(short)[0] == pytest.approx(-0.02 * short.duration_s / 2, rel=1e-12)


def test_a_slower_axis_takes_the_time_of_the_faster_one() -> None:
    motion = stop((0.0, 0.0), (0.1, 0.01))
    for part in (0.5, 0.9, 0.99):
        assert all(speed > 0.0 for speed in motion.at(part * motion.duration_s)[1])
    assert end(motion)[1] == pytest.approx(0.01 * motion.duration_s / 2, rel=1e-12)


def test_a_robot_at_rest_stops_at_once() -> None:
    motion = stop(START, (0.0, 0.0))
    assert motion.duration_s == 0.0
    assert motion.at(0.0) == (START, (0.0, 0.0))


def test_mirrored_velocities_have_mirrored_stops() -> None:
    there, back = stop((0.02,), (0.1,)), stop((-0.02,), (-0.1,))
    assert there.duration_s == back.duration_s
    assert end(there) == (-end(back)[0],)
