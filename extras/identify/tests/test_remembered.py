"""What is remembered of recordings: given back with the same commands, nothing with others."""

from __future__ import annotations

import numpy as np
import pytest

from contid.kinematics.array import Array
from contid_identify.remembered import RememberedMotion, remember

COUNT = 300
FOLDS = np.arange(COUNT, dtype=np.float64) // 30.0 % 5.0


def walk(seed: int) -> Array:
    """States of one recording: eight slow sums of sines."""
    draw, at_s = np.random.default_rng(seed), 0.1 * np.arange(COUNT)[:, None]
    waves = [np.sin(draw.uniform(0.3, 3.0, 8) * at_s + draw.uniform(0.0, 6.0, 8)) for _ in range(3)]
    return np.asarray(np.sum(waves, axis=0))


def left_over(states: Array, load: float) -> Array:
    """What a model leaves over: smooth in the states, more with a payload."""
    return np.asarray((1.0 + load) * np.tanh(2.0 * states[:, :3] * states[:, 1:4]))


def remembered(seed: int) -> RememberedMotion:
    states, loads = np.tile(walk(seed), (2, 1)), np.repeat([0.0, 1.0], COUNT)
    left = np.concatenate([left_over(walk(seed), load) for load in (0.0, 1.0)])
    found = remember(states, left, loads, np.tile(FOLDS, 2))
    assert found is not None
    return found


def test_the_same_commands_with_a_payload_between() -> None:
    found, truth = remembered(1), left_over(walk(1), 0.5)
    assert np.abs(found.added(walk(1), 0.5) - truth).mean() < 0.2 * np.abs(truth).mean()


def test_far_from_the_recordings_nothing_is_added() -> None:
    assert np.abs(remembered(1).added(walk(1) + 30.0, 1.0)).max() < 1e-6


def test_noise_is_not_remembered() -> None:
    noise = np.random.default_rng(2).normal(0.0, 1.0, (COUNT, 3))
    # The same state every time: left-out blocks show that nothing of it comes again.
    assert remember(np.tile(walk(3)[:30], (10, 1)), noise, np.zeros(COUNT), FOLDS) is None


def test_left_out_folds_in_closed_form(monkeypatch: pytest.MonkeyPatch) -> None:
    """Folds that are fitted anew choose the same: with one width and one penalty, by hand."""
    monkeypatch.setattr("contid_identify.remembered._WIDTHS", (0.3,))
    monkeypatch.setattr("contid_identify.remembered._PENALTIES", (0.5,))
    states, left = walk(4), left_over(walk(4), 0.0)
    found = remember(states, left, np.zeros(COUNT), FOLDS)
    scaled = states / (0.3 * 4.0 * states.std(axis=0))
    kernel = np.exp(-0.5 * ((scaled[:, None] - scaled[None]) ** 2).sum(axis=2))
    apart = 0.0
    for fold in range(5):
        own = fold == FOLDS
        weights = np.linalg.solve(
            kernel[~own][:, ~own] + 0.5 * np.eye(int(np.count_nonzero(~own))), left[~own]
        )
        apart += float(((left[own] - kernel[own][:, ~own] @ weights) ** 2).sum())
    assert (found is None) == (apart >= (left**2).sum())
