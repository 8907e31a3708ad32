"""The estimated load of targets comes and goes without a step."""

import math

import numpy as np
import pytest

from contid.sense.live.load_feed import (
    FADE_S,
    GAIN_PER_S,
    STALE_S,
    UNCERTAIN,
    CountedLoad,
    FedLoad,
    certain_share,
    fed,
    loaded,
)
from contid.targets import ZERO3, Target

PERIOD_S = 0.005
FORCE = (0.01, -0.02, 0.09)


def run(seconds, estimate, state=None, known=ZERO3, start_s=0.0):
    """States of every tick; `estimate(t)` is the time and the force, or None."""
    state = FedLoad() if state is None else state
    states = []
    for k in range(1, round(seconds / PERIOD_S) + 1):
        now_s = start_s + k * PERIOD_S
        state = fed(state, now_s, PERIOD_S, estimate(now_s), known)
        states.append(state)
    return states


def newest(now_s):
    """A tracker of 50 Hz."""
    return CountedLoad(math.floor(now_s / 0.02) * 0.02, FORCE)


def test_it_approaches_the_estimate_as_the_filter_does():
    states = run(2.0, newest)
    for k, state in enumerate(states, 1):
        share = 1.0 - math.exp(-GAIN_PER_S * k * PERIOD_S)
        assert state.added_n == pytest.approx([share * f for f in FORCE], rel=1e-9)


def test_what_the_target_states_is_part_of_it():
    known = (0.0, 0.0, 0.05)
    last = run(4.0, newest, known=known)[-1]
    target = Target(tip_m=(0.0, 0.0, 0.09), load_n=known)
    assert loaded(last, target).load_n == pytest.approx(FORCE, abs=1e-7)


def test_without_estimates_it_holds_then_fades_without_a_step():
    before = run(3.0, newest)
    after = run(STALE_S + FADE_S + 0.2, lambda _: newest(3.0), before[-1], start_s=3.0)
    z = np.array([state.added_n[2] for state in [*before[-2:], *after]])
    steps = np.diff(z)
    greatest = 1.5 * FORCE[2] * PERIOD_S / FADE_S  # slope of the smooth step in its middle
    assert np.abs(steps).max() <= 1.01 * greatest
    assert np.abs(np.diff(steps)).max() <= 8.0 * FORCE[2] * (PERIOD_S / FADE_S) ** 2
    assert z[round((STALE_S - 0.05) / PERIOD_S)] == pytest.approx(FORCE[2], rel=1e-3)
    assert after[-1].added_n == ZERO3
    assert loaded(after[-1], Target(tip_m=(0.0, 0.0, 0.09))).load_n == ZERO3


def test_a_tracker_that_returns_during_the_fade_makes_no_step():
    before = run(3.0, newest)
    lost = run(STALE_S + 0.5 * FADE_S, lambda _: newest(3.0), before[-1], start_s=3.0)
    start_s = 3.0 + STALE_S + 0.5 * FADE_S
    back = run(2.0, newest, lost[-1], start_s=start_s)
    z = np.array([state.added_n[2] for state in [lost[-1], *back]])
    assert np.abs(np.diff(z)).max() <= GAIN_PER_S * PERIOD_S * FORCE[2]
    assert z[-1] == pytest.approx(FORCE[2], rel=1e-2)


def test_without_a_margin_it_does_not_grow_but_falls():
    def margin_lost(now_s):
        return CountedLoad(newest(now_s).time_s, FORCE, margin=now_s < 0.2)

    states = run(3.0, margin_lost)
    z = [state.added_n[2] for state in states]
    assert z[-1] == z[round(0.25 / PERIOD_S)]
    assert 0.4 * FORCE[2] < z[-1] < 0.65 * FORCE[2]
    taken_off = run(
        3.0, lambda now_s: CountedLoad(newest(now_s).time_s, ZERO3, margin=False), states[-1], start_s=3.0
    )
    assert taken_off[-1].added_n == pytest.approx(ZERO3, abs=1e-6)


def test_noise_about_no_load_is_not_fed_and_a_load_nearly_whole():
    rng = np.random.default_rng(3)
    spread = np.array([[1.0, 0.3, 0.0], [0.3, 2.0, -0.5], [0.0, -0.5, 9.0]]) * 1e-8
    row_major = spread.ravel().tolist()
    noise = rng.multivariate_normal(np.zeros(3), spread, 2000)
    shares = np.array([certain_share(tuple(each), row_major) for each in noise.tolist()])
    # Of three normal components 97.1 % are within a squared distance of 9 (chi-squared distribution).
    assert (shares == 0.0).mean() == pytest.approx(0.971, abs=0.015)
    for count in (10.0, 30.0):
        force = (0.0, 0.0, count * 1e-4)
        squared = np.array(force) @ np.linalg.inv(spread) @ np.array(force)
        assert certain_share(force, row_major) == pytest.approx(max(0.0, 1.0 - UNCERTAIN / squared))
    assert certain_share(ZERO3, row_major) == 0.0
