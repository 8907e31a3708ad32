"""Motions to a goal that moves: within the limits, there together, whatever the goal does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import ruckig

from contid.targets import Actuation
from contid.trajectory.pursuit import AxisRates, Lines, MovingAxes, braked, frame_velocity, pursued

H_S = 0.005
RATES = AxisRates((0.06, 0.1, 0.06), (1.0, 0.9, 1.0), (20.0, 18.0, 25.0))
STILL = (0.0, 0.0, 0.0)


def shares(positions: Sequence[Actuation]) -> list[float]:
    """Greatest difference quotients of positions at ticks, as shares of the limits."""
    q = np.array(positions)
    return [
        float((np.abs(np.diff(q, order, axis=0)) / H_S**order / np.array(limit)).max())
        for order, limit in enumerate(RATES, start=1)
    ]


def test_it_catches_up_with_a_goal_that_goes_on() -> None:
    state: MovingAxes = MovingAxes(STILL, STILL, STILL)
    goal: Actuation = (0.01, -0.02, 0.005)
    velocity = (0.02, 0.01, -0.03)
    positions: list[Actuation] = [STILL] * 3
    for _ in range(400):
        goal = tuple(at + v * H_S for at, v in zip(goal, velocity, strict=True))
        found = pursued(state, goal, frame_velocity(velocity, RATES), RATES, H_S)
        assert found is not None
        state = found
        positions.append(state.position)
    assert state.position == pytest.approx(goal, abs=1e-12)
    assert state.velocity == pytest.approx(velocity, abs=1e-9)
    assert max(shares(positions)) <= 1.0 + 1e-6


@pytest.mark.parametrize(("straight", "share"), [(Lines.ROUNDED, 0.0), (Lines.EXACT, 4e-6)])
def test_a_straight_line_leads_to_the_goal_also_along_axes_that_hardly_move(
    straight: Lines, share: float
) -> None:
    after = pursued(
        MovingAxes(STILL, STILL, STILL), (1e-6, 4e-12, -8e-7), STILL, RATES, H_S, straight=straight
    )
    assert after is not None
    x, y, z = after.position
    assert 0.0 < x < 1e-6
    assert (y, z) == pytest.approx((share * x, -0.8 * x), rel=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_limits_hold_for_a_goal_that_jumps_in_every_tick(seed: int) -> None:
    random, state = np.random.default_rng(seed), MovingAxes(STILL, STILL, STILL)
    positions: list[Actuation] = [STILL] * 3
    for _ in range(300):
        goal = tuple(random.uniform(-0.02, 0.02, 3).tolist())
        found = pursued(state, goal, STILL, RATES, H_S)
        assert found is not None
        state = found
        positions.append(state.position)
    assert max(shares(positions)) <= 1.0 + 1e-6


@pytest.mark.parametrize("together", [True, False])
def test_its_bits_are_those_of_the_package_of_ruckig(together: bool) -> None:
    """In the frame of the goal, with the velocity limits of the axes as units."""
    draw, scale = np.random.default_rng(7), np.array(RATES.velocity)
    given, way, kinds = ruckig.InputParameter(3), ruckig.Trajectory(3), ruckig.Synchronization
    given.synchronization = kinds.Phase if together else kinds.No
    given.target_position = given.target_velocity = given.target_acceleration = [0.0] * 3
    given.max_acceleration = (np.array(RATES.acceleration) / scale).tolist()
    given.max_jerk = ((1.0 - 1e-6) * (np.array(RATES.jerk) / scale)).tolist()
    for _ in range(100):
        at, goal = draw.uniform(-0.02, 0.02, (2, 3))
        velocity, frame = draw.uniform(-0.9, 0.9, (2, 3)) * scale
        acceleration = draw.uniform(-0.1, 0.1, 3)
        given.current_position = ((at - goal + frame * H_S) / scale).tolist()
        given.current_velocity = ((velocity - frame) / scale).tolist()
        given.current_acceleration = (acceleration / scale).tolist()
        given.max_velocity, given.min_velocity = (
            (1.0 - frame / scale).tolist(),
            (-1.0 - frame / scale).tolist(),
        )
        ruckig.Ruckig(3).calculate(given, way)
        p, v, a = (np.array(each) for each in way.at_time(H_S)[:3])
        state = MovingAxes(*(tuple(each.tolist()) for each in (at, velocity, acceleration)))
        after = pursued(state, tuple(goal.tolist()), tuple(frame.tolist()), RATES, H_S, together)
        assert after is not None
        assert after.position == tuple((goal + p * scale).tolist())
        assert after.velocity == tuple((frame + v * scale).tolist())
        assert after.acceleration == tuple((a * scale).tolist())


def test_a_goal_beyond_the_velocity_is_one_that_jumped() -> None:
    assert frame_velocity((0.07, 0.0, 0.0), RATES) == STILL
    assert frame_velocity((0.03, -0.02, 0.0), RATES) == (0.03, -0.02, 0.0)


def test_a_stop_together_and_one_by_one() -> None:
    state = MovingAxes(STILL, (0.05, 0.01, 0.0), (0.2, 0.0, -0.1))
    for together in (True, False):
        after: MovingAxes | None = state
        for _ in range(200):
            assert after is not None
            after = braked(after, RATES, H_S, together)
        assert after is not None
        assert after.velocity == pytest.approx(STILL, abs=1e-9)
