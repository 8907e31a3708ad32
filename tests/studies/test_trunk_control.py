"""The study of a trunk in motion, on a stated twin: limits of its motors, jumps, and what feedback finds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from studies.moving.trunk_control import eight, follow, impulses, jump
from studies.moving.trunk_twin import LIMIT_DEG, Motors, MovingTrunk, TrunkMode, terms, violations


@pytest.fixture(scope="module")
def model() -> MovingTrunk:
    """Motors that move the tip by 1 to 2 mm a degree, and bend back a little."""
    rng = np.random.default_rng(3)
    weights = np.zeros((terms(np.zeros((1, 6))).shape[1], 3))
    weights[:6] = rng.uniform(-80.0, 80.0, (6, 3))
    weights[6:] = rng.uniform(-2.0, 2.0, weights[6:].shape)
    return MovingTrunk(weights, TrunkMode(0.06, 2.6), 0.0, 12)


def test_motors_keep_their_limits_wherever_they_are_sent(model: MovingTrunk) -> None:
    rng = np.random.default_rng(1)
    motors = Motors(model, np.zeros(6))
    goals = np.repeat(rng.uniform(-LIMIT_DEG, LIMIT_DEG, (60, 6)), 20, axis=0)
    angles = np.array([motors.move(goal) for goal in goals])
    assert violations(angles) == 0
    assert np.abs(np.diff(angles, axis=0)).max() > 1.0
    assert violations(np.array([np.zeros(6), np.full(6, 3.0)])) == 6


def test_a_jump_with_a_shaper_for_a_low_frequency_is_still_at_a_fifth_more_or_less(
    model: MovingTrunk,
) -> None:
    for share in (0.8, 1.0, 1.2):
        twin = replace(model, mode=TrunkMode(0.06, share * 2.6))
        free, shaped = (jump(twin, model, impulses(model, kind)) for kind in ("none", "zv, low"))
        assert shaped.overshoot < min(0.05, 0.6 * free.overshoot)
        assert shaped.within_s < 0.5
        assert shaped.violations == 0


def test_feedback_finds_the_gain_of_another_payload(model: MovingTrunk) -> None:
    """A twin that answers with 0.8 of the model: the third lap is nearer than by the lead alone."""
    twin, path = replace(model, weights=0.8 * model.weights), eight(3)
    last = slice(400, None)
    led, closed = (
        np.sqrt(np.mean(np.sum((follow(twin, model, path, True, each).tips - path)[last] ** 2, axis=1)))
        for each in (False, True)
    )
    assert led > 4.0
    assert closed < 0.4 * led
