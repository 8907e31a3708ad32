"""Play and friction before the swing of a tip: found in plants that have them, in no others."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_identify.answer import CommandedTrace
from contid_identify.printed import motion_lines
from contid_identify.remembered import near_bends
from contid_identify.sections.play import NO_PLAY, AxisPlay
from contid_identify.tip_fit.trace_rows import LoadedTrace
from contid_identify.tip_motion import TipMotion
from contid_identify.tip_motion_file import read_tip_motion, write_tip_motion
from contid_identify.tip_motion_fit import fit_tip_motion

pytestmark = pytest.mark.slow

PERIOD_S = 0.02
HZ, RATIO, DELAY_S = 2.0, 0.4, 0.1
HALF, SHARE = 0.03, 0.06


def commands(seed: int) -> Array:
    """40 s of sums of sines on two axes."""
    draw, at_s = np.random.default_rng(seed), np.arange(0.0, 40.0, PERIOD_S, dtype=np.float64)
    found = []
    for _ in range(2):
        waves = [
            draw.uniform(0.3, 1.0) * np.sin(6.283 * draw.uniform(0.1, 1.0) * at_s + draw.uniform(0.0, 6.283))
            for _ in range(6)
        ]
        found.append(np.sum(waves, axis=0) / 3.0)
    return np.asarray(np.minimum(at_s, 1.0)[:, None] * np.column_stack(found))


def dragged(sent: Array, half: float, share: float) -> Array:
    """An axis between two stops, case by case: it is pushed, pulled, or stays."""
    out, at = np.empty_like(sent), sent[0].copy()
    for k, row in enumerate(sent):
        for j, value in enumerate(row):
            stop = half + share * abs(value)
            if value - at[j] > stop:
                at[j] = value - stop
            elif at[j] - value > stop:
                at[j] = value + stop
        out[k] = at
    return out


def trace_of(seed: int, half: float, share: float) -> CommandedTrace:
    """Tips [m] of a plant whose swing is discretised by scipy, with 0.3 mm of noise."""
    sent, rate = commands(seed), 2.0 * np.pi * HZ
    above, below, _ = cont2discrete(([rate**2], [1.0, 2.0 * RATIO * rate, rate**2]), PERIOD_S, method="zoh")
    moved = dragged(sent - sent.mean(axis=0), half, share)
    late = np.concatenate([np.repeat(moved[:1], round(DELAY_S / PERIOD_S), axis=0), moved])[: len(moved)]
    x = late[0] + lfilter(above.ravel(), below, late - late[0], axis=0)
    tips = 0.1 * np.column_stack([x[:, 0], x[:, 1], 0.3 * (x**2).sum(axis=1)])
    noise = np.random.default_rng(seed + 90).normal(0.0, 3e-4, tips.shape)
    return CommandedTrace(PERIOD_S, sent, np.arange(float(len(sent))) * PERIOD_S, tips + noise)


def fitted(seed: int, half: float, share: float) -> TipMotion:
    with pytest.MonkeyPatch.context() as few:
        few.setattr("contid_identify.remembered.MOST", 200)
        return fit_tip_motion("arm", ("a", "b"), [LoadedTrace(trace_of(seed, half, share))], None, "a test")


@pytest.fixture(scope="module")
def model() -> TipMotion:
    return fitted(1, HALF, SHARE)


def test_play_and_friction_are_found(model: TipMotion) -> None:
    assert model.play.half == pytest.approx(HALF, abs=0.006)
    assert model.play.share == pytest.approx(SHARE, abs=0.015)
    assert model.delay_s == pytest.approx(DELAY_S, abs=0.004)
    assert model.frequency_hz == pytest.approx(HZ, rel=0.04)
    other = trace_of(2, HALF, SHARE)
    off = np.linalg.norm(model.predict(other.sent, PERIOD_S) - other.measured, axis=1)
    # 0.3 mm of noise on each component is 0.52 mm; the play alone moves the tip by 3 mm.
    assert np.sqrt((off**2).mean()) < 1.5e-3
    assert any("play of +- 0.0" in line for line in motion_lines(model))


def test_none_is_found_where_there_is_none() -> None:
    found = fitted(3, 0.0, 0.0)
    assert found.play == NO_PLAY
    assert found.delay_s == pytest.approx(DELAY_S, abs=0.003)


def test_a_tip_that_turns_back_holds() -> None:
    column = np.array([0.0, 1.0, 0.9, 0.5, -1.0])[:, None]
    assert AxisPlay(0.1, 0.0).behind(column)[:, 0].tolist() == pytest.approx([0.0, 0.9, 0.9, 0.6, -0.9])
    assert AxisPlay(0.0, 0.1).behind(column)[:, 0].tolist() == pytest.approx([0.0, 0.9, 0.9, 0.55, -0.9])
    assert NO_PLAY.behind(column) is column


def test_the_file_has_it(model: TipMotion, tmp_path: Path) -> None:
    file = tmp_path / "m.json"
    write_tip_motion(model, file)
    sent = commands(11)
    assert np.array_equal(read_tip_motion(file).predict(sent, PERIOD_S), model.predict(sent, PERIOD_S))
    data = json.loads(file.read_text())
    del data["play"], data["near"]
    file.write_text(json.dumps(data))
    before = read_tip_motion(file)
    assert before.play == NO_PLAY
    assert np.array_equal(
        before.predict(sent, PERIOD_S), replace(model, play=NO_PLAY).predict(sent, PERIOD_S)
    )
    numbers = {"half": 0.0, "share": 0.0}
    for bad in ({**numbers, "half": -0.1}, {**numbers, "share": 1.0}, {**numbers, "half": "much"}, {}):
        file.write_text(json.dumps({**data, "play": bad}))
        with pytest.raises(ContidError, match=r"play|share|half|much"):
            read_tip_motion(file)


def test_bends_nearby_are_chosen_by_what_was_left_out() -> None:
    """A bump that only one section has: corrected where bends are near, nothing far away."""
    draw = np.random.default_rng(4)
    bends = draw.uniform(-1.0, 1.0, (600, 4))
    bump = np.exp(-0.5 * ((bends[:, :2] - 0.3) ** 2).sum(axis=1) / 0.4**2)
    left = 5e-3 * bump[:, None] * [1.0, 0.0, -1.0] + draw.normal(0.0, 1e-3, (600, 3))
    folds = np.arange(600.0) // 30.0 % 5.0
    found = near_bends(bends, left, np.zeros(600), folds)
    assert found is not None
    at = draw.uniform(-0.8, 0.8, (200, 4))
    truth = 5e-3 * np.exp(-0.5 * ((at[:, :2] - 0.3) ** 2).sum(axis=1) / 0.4**2)
    assert np.sqrt(((found.added(at, 0.0)[:, 0] - truth) ** 2).mean()) < 0.4 * np.sqrt((truth**2).mean())
    assert np.abs(found.added(np.full((1, 4), 6.0), 0.0)).max() < 1e-6
    assert near_bends(bends, draw.normal(0.0, 1e-3, (600, 3)), np.zeros(600), folds) is None
