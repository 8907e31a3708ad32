"""Approach: limits are kept, everything arrives, from any state, as by the package of ruckig."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import ruckig
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.trajectory.approach import Approach, MotionError

VELOCITY, ACCELERATION, JERK = 0.1, 1.0, 20.0
lengths = st.integers(0, 200_000).map(lambda micrometres: micrometres / 1e6)


def approach(
    start: Sequence[float],
    speed: Sequence[float],
    goal: Sequence[float],
    *limits: float,
    straight: bool = False,
) -> Approach:
    """With the same velocity, acceleration and jerk limits for all axes."""
    velocity, acceleration, jerk = ((each,) * len(start) for each in limits)
    return Approach(start, speed, goal, velocity, acceleration, jerk, straight=straight)


def derivatives(motion: Approach, rate: float = 2000.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and its numeric derivative (acceleration) on a fine grid."""
    times = np.arange(0.0, motion.duration_s, 1.0 / rate)
    positions, velocities = (np.array(each) for each in zip(*[motion.at(t) for t in times], strict=True))
    return positions, velocities, np.diff(velocities, axis=0) * rate


@settings(max_examples=60, deadline=None)
@given(start=st.tuples(lengths, lengths, lengths), goal=st.tuples(lengths, lengths, lengths))
def test_an_approach_starts_and_ends_at_rest_within_its_limits(
    start: tuple[float, ...], goal: tuple[float, ...]
) -> None:
    motion = approach(start, (0.0,) * 3, goal, VELOCITY, ACCELERATION, JERK)
    assert start == goal or motion.at(0.0) == (start, (0.0,) * 3)
    assert motion.at(motion.duration_s) == motion.at(1e9) == (goal, (0.0,) * 3)
    if motion.duration_s < 2e-3:
        return
    positions, velocities, accelerations = derivatives(motion)
    assert np.abs(velocities).max() <= VELOCITY * (1 + 1e-9)
    assert np.abs(accelerations).max() <= ACCELERATION * (1 + 1e-6)
    assert np.abs(np.diff(accelerations, axis=0)).max(initial=0.0) * 2000 <= JERK * (1 + 1e-4)
    low, high = np.minimum(start, goal), np.maximum(start, goal)
    assert np.all(positions >= low - 1e-12)
    assert np.all(positions <= high + 1e-12)
    # Just before the end everything is still arriving together, and close.
    almost = motion.at(motion.duration_s - 1e-6)[0]
    assert np.allclose(almost, goal, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(start=st.tuples(lengths, lengths, lengths), goal=st.tuples(lengths, lengths, lengths))
def test_a_straight_approach_is_a_straight_line_and_takes_as_long(
    start: tuple[float, ...], goal: tuple[float, ...]
) -> None:
    motion = approach(start, (0.0,) * 3, goal, VELOCITY, ACCELERATION, JERK, straight=True)
    own = approach(start, (0.0,) * 3, goal, VELOCITY, ACCELERATION, JERK)
    assert motion.duration_s == pytest.approx(own.duration_s, rel=2e-5)
    way = np.subtract(goal, start)
    for share in (0.1, 0.3, 0.5, 0.7, 0.9):
        gone = np.subtract(motion.at(share * motion.duration_s)[0], start)
        assert np.abs(np.cross(gone, way)).max() <= 1e-10 * max(1e-3, float(np.linalg.norm(way)))


def test_an_approach_may_begin_in_motion() -> None:
    motion = approach((0.05,), (0.08,), (0.05,), VELOCITY, ACCELERATION, JERK)
    assert motion.at(0.0)[1] == (0.08,)
    assert motion.at(motion.duration_s) == ((0.05,), (0.0,))
    assert max(motion.at(t)[0][0] for t in np.linspace(0, motion.duration_s, 100)) > 0.05


@pytest.mark.parametrize("steps", [1, 6, 27, 1000])
@pytest.mark.parametrize("axes", [1, 2, 6])
def test_a_speed_at_the_limit_but_for_its_rounding_is_the_limit(axes: int, steps: int) -> None:
    """Axes that move alike, stopped at full speed: the solver finds no way for a few float64 steps more."""
    speed = VELOCITY * (1.0 + steps * 2.2e-16)
    for start in np.linspace(0.0, 0.1, 50):
        motion = approach((start,) * axes, (speed,) * axes, (0.1,) * axes, VELOCITY, ACCELERATION, JERK)
        assert motion.at(motion.duration_s) == ((0.1,) * axes, (0.0,) * axes)


def test_axes_arrive_together_and_pressures_behave_as_lengths() -> None:
    millimetres = approach((0.0, 0.0), (0.0, 0.0), (0.1, 0.01), VELOCITY, ACCELERATION, JERK)
    pascals = approach((0.0, 0.0), (0.0, 0.0), (1e5, 1e4), VELOCITY * 1e6, ACCELERATION * 1e6, JERK * 1e6)
    assert pascals.duration_s == pytest.approx(millimetres.duration_s, rel=1e-9)
    half = millimetres.duration_s / 2
    assert np.allclose(np.array(pascals.at(half)[0]) / 1e6, millimetres.at(half)[0], atol=1e-12)
    # Time-synchronised: the short way is still under way when the long one is nearly there.
    assert millimetres.at(0.95 * millimetres.duration_s)[0][1] < 0.01


def test_the_same_numbers_give_the_same_bits() -> None:
    def samples() -> list[object]:
        motion = approach((0.0, 0.1), (0.01, 0.0), (0.1, 0.01), VELOCITY, ACCELERATION, JERK)
        return [motion.at(i / 200) for i in range(400)]

    assert samples() == samples()


def test_numbers_that_are_none_are_refused() -> None:
    with pytest.raises(MotionError, match="no motion"):
        approach((float("nan"),), (0.0,), (1.0,), 1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("start", "goal"), [((0.06, 0.06), (0.0808, 0.065)), ((0.06, 0.06), (0.065, 0.0522))]
)
def test_a_way_that_just_reaches_the_acceleration_has_a_motion(
    start: tuple[float, float], goal: tuple[float, float]
) -> None:
    """2 a^3 / j^2 = 5 mm: ruckig 0.19 raises "error in step 1" for such an axis beside another one."""
    motion = approach(start, (0.0, 0.0), goal, 0.06, 1.0, 20.0)
    assert motion.at(motion.duration_s)[0] == goal
    alone = [approach((a,), (0.0,), (b,), 0.06, 1.0, 20.0) for a, b in zip(start, goal, strict=True)]
    assert motion.duration_s == pytest.approx(max(each.duration_s for each in alone), rel=1e-4)
    jerks = np.diff([motion.at(t)[1] for t in np.linspace(0, motion.duration_s, 2000)], n=2, axis=0)
    assert np.abs(jerks).max() / (motion.duration_s / 1999) ** 2 <= 20.0 * 1.01


@pytest.mark.parametrize("seed", range(3))
def test_its_bits_are_those_of_the_package_of_ruckig(seed: int) -> None:
    draw = np.random.default_rng(seed)
    for _ in range(40):
        axes, straight = int(draw.integers(1, 7)), bool(draw.integers(2))
        most, jerk = draw.uniform(2.0, 20.0, axes).tolist(), draw.uniform(40.0, 400.0, axes).tolist()
        start, goal = draw.uniform(-1.0, 1.0, axes).tolist(), draw.uniform(-1.0, 1.0, axes).tolist()
        velocity = draw.uniform(-0.9, 0.9, axes).tolist()
        acceleration = (0.1 * draw.uniform(-1.0, 1.0, axes)).tolist()
        given = ruckig.InputParameter(axes)
        given.current_position, given.target_position = start, goal
        given.current_velocity, given.current_acceleration = velocity, acceleration
        given.max_velocity, given.max_acceleration, given.max_jerk = [1.0] * axes, most, jerk
        kinds = ruckig.Synchronization
        given.synchronization = kinds.Phase if straight else kinds.Time
        way = ruckig.Trajectory(axes)
        ruckig.Ruckig(axes).calculate(given, way)
        motion = Approach(
            start,
            velocity,
            goal,
            (1.0,) * axes,
            most,
            jerk,
            straight=straight,
            start_acceleration=acceleration,
        )
        assert motion.duration_s == way.duration
        for share in (0.01, 0.3, 0.5, 0.99):
            position, speed, _ = way.at_time(share * way.duration)
            assert motion.at(share * way.duration) == (tuple(position), tuple(speed))


@pytest.mark.parametrize("wrong", ["acceleration", "limit"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), 0.0])
@pytest.mark.parametrize("straight", [False, True])
def test_numbers_of_which_there_is_no_motion_are_refused(wrong: str, value: float, straight: bool) -> None:
    """Whatever way it takes: limits that differ between the axes have one of their own."""
    one = (1.0, 1.0)
    for limit in range(3):
        limits = [one, one, one]
        begin = (0.0, 0.0)
        if wrong == "acceleration":
            begin = (value or float("-inf"), 0.0)
        else:
            limits[limit] = (value, 2.0)
        with pytest.raises(MotionError):
            Approach((0.0, 0.0), (0.0, 0.0), one, *limits, straight=straight, start_acceleration=begin)
