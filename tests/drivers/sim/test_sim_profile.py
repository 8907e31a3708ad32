"""Profiles obey their limits and end at their goals, however often they are looked at; their devices."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.kernels import load

kernel = load("plant")
finite = st.floats(-50.0, 50.0)
limit = st.floats(0.5, 40.0)


@given(position=finite, velocity=st.floats(-30, 30), goal=finite, v_max=limit, a_max=st.floats(1.0, 500.0))
def test_trapezoid_is_continuous_and_ends_at_rest_at_the_goal(position, velocity, goal, v_max, a_max):
    phases = kernel.plan(2.0, position, velocity, goal, v_max, a_max)
    assert phases[-1].position == goal
    assert phases[-1].velocity == phases[-1].acceleration == 0.0
    assert len(phases) <= 4
    at, speed = position, velocity
    for phase, after in itertools.pairwise(phases):
        assert phase.position == pytest.approx(at, abs=1e-6)
        assert phase.velocity == pytest.approx(speed, abs=1e-6)
        assert abs(phase.acceleration) <= a_max * (1 + 1e-12)
        assert after.start_s >= phase.start_s
        at, speed = phase.at(after.start_s)
        assert abs(speed) <= max(v_max, abs(velocity)) * (1 + 1e-9)
    assert at == pytest.approx(goal, abs=1e-6)
    # A vanishing last stretch leaves the square root of the rounding in its speed.
    assert speed == pytest.approx(0.0, abs=1e-4)


@given(goal=finite, v_max=limit, a_max=st.floats(1.0, 500.0))
def test_from_rest_it_takes_the_time_of_the_textbook(goal, v_max, a_max):
    distance = abs(goal)
    if distance >= v_max**2 / a_max:
        expected = distance / v_max + v_max / a_max
    else:
        expected = 2.0 * math.sqrt(distance / a_max)
    assert kernel.plan(0.0, 0.0, 0.0, goal, v_max, a_max)[-1].start_s == pytest.approx(
        expected, rel=1e-9, abs=1e-12
    )


def test_without_limits_the_goal_is_reached_at_once():
    assert kernel.plan(1.0, 0.0, 0.0, 5.0, math.inf, math.inf)[0].position == 5.0
    slew = kernel.plan(1.0, 0.0, 0.0, -6.0, 2.0, math.inf)
    assert [phase.start_s for phase in slew] == [1.0, 4.0]


@given(
    goals=st.lists(finite, min_size=1, max_size=4),
    tau_s=st.sampled_from([0.0, 0.005, 0.1]),
    pieces=st.integers(1, 37),
)
def test_many_short_steps_equal_one_long_step(goals, tau_s, pieces):
    whole, split = kernel.ProfileMotion(0.0, 1.0, tau_s), kernel.ProfileMotion(0.0, 1.0, tau_s)
    for turn, goal in enumerate(goals, start=1):
        for motion in (whole, split):
            motion.go(goal, 5.0, 80.0)
        for piece in range(1, pieces + 1):
            split.advance(turn - 1 + piece / pieces)
        whole.advance(float(turn))
        assert split.value == pytest.approx(whole.value, abs=1e-9)


def test_response_of_a_step_is_the_exponential():
    motion = kernel.ProfileMotion(0.0, 0.0, 0.1)
    motion.go(1.0, math.inf, math.inf)
    motion.advance(0.25)
    assert motion.value == pytest.approx(1.0 - math.exp(-2.5), rel=1e-14)


def test_response_lags_a_ramp_by_tau():
    motion = kernel.ProfileMotion(0.0, 0.0, 0.02)
    motion.go(100.0, 5.0, math.inf)
    motion.advance(1.0)
    assert motion.value == pytest.approx(5.0 * (1.0 - 0.02), rel=1e-12)
    assert motion.velocity == pytest.approx(5.0, rel=1e-12)


def test_response_satisfies_its_differential_equation():
    motion = kernel.ProfileMotion(0.0, 0.3, 0.05)
    motion.go(2.0, 4.0, 30.0)
    h = 1e-5
    for step in range(1, 60):
        motion.advance(step * 0.02 - h)
        before = motion.value
        motion.advance(step * 0.02)
        derivative = motion.velocity
        motion.advance(step * 0.02 + h)
        # The third derivative jumps where phases meet, hence the tolerance of the difference quotient.
        assert (motion.value - before) / (2 * h) == pytest.approx(derivative, abs=5e-3)


def test_stop_and_freeze():
    moving = kernel.ProfileMotion(0.0, 0.0, 0.02)
    moving.go(10.0, 5.0, math.inf)
    moving.advance(0.5)
    stopped_at, was = moving.reference[0], moving.value
    moving.stop()
    moving.advance(2.0)
    assert moving.value == pytest.approx(stopped_at)
    assert stopped_at - was == pytest.approx(0.1)
    moving.go(-10.0, 5.0, math.inf)
    moving.advance(2.3)
    moving.freeze()
    here = moving.value
    moving.advance(9.0)
    assert moving.value == here


@given(
    position=finite,
    velocity=st.floats(-8, 8),
    goal=finite,
    drift=st.floats(-8.0, 8.0),
    a_max=st.floats(10.0, 500.0),
)
def test_a_moving_goal_is_met_within_the_limits(position, velocity, goal, drift, a_max):
    phases = kernel.plan_to_moving(1.0, position, velocity, goal, drift, 400.0, 9.0, a_max)
    at, speed = position, velocity
    for phase, after in itertools.pairwise(phases):
        assert phase.position == pytest.approx(at, abs=1e-5)
        assert phase.velocity == pytest.approx(speed, abs=1e-4)
        assert abs(phase.acceleration) <= a_max * (1 + 1e-12)
        at, speed = phase.at(after.start_s)
        assert abs(speed) <= 9.0 * (1 + 1e-9)
    assert phases[-1].position == goal
    assert phases[-1].velocity == phases[-1].acceleration == 0.0
    with_it = [phase for phase in phases if phase.start_s < 399.0][-1]
    assert with_it.at(399.0)[0] == pytest.approx(goal + 398.0 * drift, abs=1e-3)


def simulated(
    *, quantum: float = 0.1, limit_a: float = 1.0, overload_s: float = math.inf, tau_s: float = 0.1
) -> Any:
    """A device of top speed 5 at 0, whose current is 2 A per unit of lag."""
    return kernel.SimulatedDevice(
        0.0, 0.0, tau_s, 5.0, quantum, 0.25, -10.0, 10.0, math.inf, limit_a, overload_s, 2.0, False
    )


@pytest.mark.parametrize(
    ("asked", "step", "goal"),
    [
        (0.26, 0.1, 0.3), (-0.26, 0.1, -0.3), (0.25, 0.5, 0.0), (0.75, 0.5, 1.0), (-0.75, 0.5, -1.0),
        (99.0, 0.5, 10.0), (-99.0, 0.5, -10.0),
    ],
)  # fmt: skip
def test_goals_are_whole_steps_within_the_range(asked: float, step: float, goal: float) -> None:
    """Half a step goes to the even number of steps."""
    assert simulated(quantum=step).command(asked) == pytest.approx(goal, abs=1e-15)


def test_a_reading_of_no_steps_has_no_sign() -> None:
    value, *_ = simulated().read(-0.04)
    assert math.copysign(1.0, value) == 1.0


def test_a_blocked_shaft_warms_up_to_its_current_and_gives_up() -> None:
    """2 units off it would draw 4 A, so it draws the 1 A that it has: 30 K, in 120 s all but 1/e of it."""
    device = simulated(overload_s=200.0)
    device.switch_on()
    device.blocked = True
    device.command(2.0)
    assert not device.advance(120.0)
    _, velocity, current_a, temperature_c = device.read(0.0)
    assert (velocity, current_a) == (0.0, 1.0)
    assert temperature_c == round(25.0 + 30.0 * (1.0 - math.exp(-1.0)))
    assert not device.advance(199.0)
    assert device.advance(201.0)


def test_a_device_without_power_draws_no_current() -> None:
    device = simulated()
    device.command(2.0)
    device.advance(0.1)
    assert device.read(0.0)[2] == 0.0
    device.switch_on()
    device.command(2.0)
    device.advance(0.15)
    lag = device.reference[0] - device.value
    friction = 0.05 * math.tanh(device.velocity / 0.05)
    assert device.read(0.0)[2] == pytest.approx(min(1.0, 2.0 * lag + friction), rel=1e-12)


def test_a_shaft_that_a_body_holds_reads_the_angle_and_the_current_of_that() -> None:
    device = simulated()
    device.switch_on()
    device.bear(0.5, 0.3)
    assert device.read(0.0)[::2] == (0.5, 0.3)
