"""Predictive control of a trunk, on a stated twin: limits, a jump, and ticks without a solution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from contid_identify.chambers.motion import filled
from studies.moving.recordings import PERIOD_S
from studies.moving.trunk_predictive import steered
from studies.moving.trunk_program import PredictiveRun, of_jump
from studies.moving.trunk_twin import LIMIT_DEG, Motors, MovingTrunk, TrunkMode, terms, violations


@pytest.fixture(scope="module")
def model() -> MovingTrunk:
    """Motors that move the tip by 1 to 2 mm a degree, and bend back a little."""
    rng = np.random.default_rng(3)
    weights = np.zeros((terms(np.zeros((1, 6))).shape[1], 3))
    weights[:6] = rng.uniform(-80.0, 80.0, (6, 3))
    weights[6:] = rng.uniform(-2.0, 2.0, weights[6:].shape)
    return MovingTrunk(weights, TrunkMode(0.06, 2.6), 0.0, 12)


def jumped(model: MovingTrunk, twin: MovingTrunk, iterations: int) -> PredictiveRun:
    pytest.importorskip("piqp")
    begin = Motors(model, np.zeros(6)).wished(np.array([-40.0, 0.0]), 12)
    goal = np.tile(np.array([40.0, 0.0]), (130, 1))
    return steered(twin, model, goal, False, False, begin, iterations)


def test_motors_that_do_not_brake_for_their_goal_stop_at_the_ends_of_travel(model: MovingTrunk) -> None:
    rng = np.random.default_rng(1)
    motors = Motors(model, np.zeros(6))
    goals = np.repeat(rng.uniform(-2.0 * LIMIT_DEG, 2.0 * LIMIT_DEG, (60, 6)), 20, axis=0)
    angles = np.array([motors.follow(goal) for goal in goals])
    assert violations(angles) == 0
    assert np.abs(np.diff(angles, axis=0)).max() > 1.0


@pytest.mark.parametrize("share", [0.8, 1.2])
def test_a_jump_is_still_at_a_fifth_more_or_less(model: MovingTrunk, share: float) -> None:
    twin = replace(model, mode=TrunkMode(0.06, share * 2.6))
    run = jumped(model, twin, 15)
    text = of_jump(run, twin)
    arrival, overshoot = (float(word) for word in (text.split()[4], text.split()[-2]))
    assert arrival < 0.55
    assert overshoot < 6.0
    assert run.fallbacks == 0
    assert violations(run.angles) == 0


def test_without_a_solution_the_motors_go_to_the_path_within_their_limits(model: MovingTrunk) -> None:
    run = jumped(model, model, 1)
    assert run.fallbacks == len(run.tips)
    assert violations(run.angles) == 0
    assert np.linalg.norm(run.tips[-1] - [40.0, 0.0]) < 2.0


def test_filling_and_venting_have_time_constants_of_their_own() -> None:
    steps = np.concatenate((np.zeros((1, 1)), np.ones((40, 1)), np.zeros((40, 1))))
    out = filled(steps, PERIOD_S, 0.5, 2.0)[:, 0]
    at_s = PERIOD_S * np.arange(1, 41)
    assert out[1:41] == pytest.approx(1.0 - np.exp(-at_s / 0.5))
    assert out[41:] == pytest.approx(out[40] * np.exp(-at_s / 2.0))
