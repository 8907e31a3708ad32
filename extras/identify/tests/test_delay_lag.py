"""Delay and lag of axes whose truth is known: simulated apart, by scipy on a finer grid."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.base import Quantity
from contid_identify.answer import CommandedTrace
from contid_identify.delay_lag import AxisAnswer, fit_axis
from contid_identify.excitation import excitation_of
from contid_identify.stages import _identified_axis
from tests.oracles.integrated_lag import PERIOD_S, exciting_commands, integrated

DELAY_S, LAG_S, NOISE_MM = 0.0437, 0.031, 0.3


def trace(sent: Array, delay_s: float, lag_s: float, noise: Array, gain: float = 1.0) -> CommandedTrace:
    at_s = np.arange(float(len(sent))) * PERIOD_S + 0.003
    measured = gain * integrated(sent, at_s, delay_s, lag_s) + noise[: len(at_s)]
    return CommandedTrace(PERIOD_S, sent, at_s, measured[:, None])


def noises(seed: int, count: int) -> Array:
    """White for even seeds, of a memory of ten samples for odd ones; as large."""
    white = np.random.default_rng(seed).normal(size=count) * NOISE_MM
    return np.asarray(lfilter([np.sqrt(1 - 0.9**2)], [1.0, -0.9], white)) if seed % 2 else white


def fits(seeds: int, duration_s: float = 40.0) -> list[AxisAnswer]:
    sent = exciting_commands(4, duration_s, 15.0, 120.0)
    clean = trace(sent, DELAY_S, LAG_S, np.zeros(len(sent)))
    return [
        fit_axis(
            [CommandedTrace(PERIOD_S, sent, clean.at_s, clean.measured + noises(seed, len(sent))[:, None])]
        )
        for seed in range(seeds)
    ]


def test_the_delay_is_found_within_two_milliseconds_at_a_trackers_noise() -> None:
    for found in fits(4):
        assert abs(found.delay_s.value - DELAY_S) < 2e-3
        assert abs(found.lag_s.value - LAG_S) < 3e-3
        assert abs(found.gain.value - 1.0) < 0.02
        assert found.delay_s.half < 4e-3


@pytest.mark.slow
@pytest.mark.campaign
@pytest.mark.timeout(1200)
def test_intervals_hold_the_truth_in_100_seeds() -> None:
    """Measured: 88, 93 and 95 of 100. Standard errors of such counts are 2 to 3."""
    held = np.zeros(3)
    worst = 0.0
    for found in fits(100, 60.0):
        pairs = ((found.delay_s, DELAY_S), (found.lag_s, LAG_S), (found.sum_s, DELAY_S + LAG_S))
        held += [interval.low <= true <= interval.high for interval, true in pairs]
        worst = max(worst, abs(found.delay_s.value - DELAY_S))
    assert (held >= 85).all()
    assert 90 <= held.mean() <= 99
    assert worst < 2.5e-3


def test_the_stages_are_judged_on_what_was_kept_out() -> None:
    sent = exciting_commands(5, 30.0, 15.0, 120.0)
    found = fit_axis([trace(sent, 0.22, 0.1, noises(2, len(sent)), 0.9)])
    still, late, both = found.stages
    assert still.kept_out.rmse > 3.0 * late.kept_out.rmse > 3.0 * both.kept_out.rmse
    assert both.kept_out.rmse == pytest.approx(NOISE_MM, rel=0.1)
    assert both.kept_out.low < both.kept_out.rmse < both.kept_out.high
    assert found.samples[1] == pytest.approx(sum(found.samples) / 5, rel=0.02)
    assert found.delay_s.value == pytest.approx(0.22, abs=3e-3)
    assert found.gain.value == pytest.approx(0.9, abs=0.01)


def test_recordings_are_fitted_together() -> None:
    parts = [exciting_commands(seed, 12.0, 10.0, 80.0) for seed in (6, 7)]
    found = fit_axis([trace(sent, 0.06, 0.05, noises(2 * k, len(sent))) for k, sent in enumerate(parts)])
    assert found.delay_s.value == pytest.approx(0.06, abs=4e-3)


def test_a_delay_alone_is_known_to_a_period() -> None:
    sent = exciting_commands(8, 20.0, 10.0, 80.0)
    at_s = np.arange(float(len(sent))) * PERIOD_S
    late = sent[np.clip(np.floor((at_s - 0.04) / PERIOD_S + 1e-9).astype(int), 0, None)]
    found = fit_axis([CommandedTrace(PERIOD_S, sent, at_s, late[:, None])])
    assert found.delay_s.low - 1e-6 <= 0.04 <= found.delay_s.high + 1e-6
    assert found.delay_s.half >= PERIOD_S


def test_what_the_data_cannot_show_is_stated_before_the_fit() -> None:
    count = 3000
    at_s = np.arange(float(count)) * PERIOD_S
    still = CommandedTrace(PERIOD_S, np.zeros(count), at_s, noises(0, count)[:, None])
    assert "hardly moved" in excitation_of([still]).warnings[0]
    slow = trace(np.sin(2 * np.pi * 0.05 * at_s), DELAY_S, LAG_S, 0.1 * noises(0, count))
    assert "the sum of delay and lag" in excitation_of([slow]).warnings[0]
    good = excitation_of([trace(exciting_commands(9, 30.0, 15.0, 120.0), DELAY_S, LAG_S, noises(0, count))])
    assert good.warnings == ()
    assert good.noise == pytest.approx(NOISE_MM, rel=0.2)
    assert good.delay_s < 2e-3
    with pytest.raises(ContidError, match="never commanded to move"):
        fit_axis([still])
    with pytest.raises(ContidError, match="at least 100"):
        fit_axis([CommandedTrace(PERIOD_S, np.arange(9.0), at_s[:9], np.zeros((9, 1)))])


def test_an_axis_that_moves_in_the_shorter_recording_only_is_fitted() -> None:
    """Recordings that move one axis after the other: the longest one leaves this axis at rest."""
    moves = exciting_commands(9, 30.0, 15.0, 120.0)
    rests = trace(np.full(2 * len(moves), moves[0]), DELAY_S, LAG_S, noises(0, 2 * len(moves)))
    moved = trace(moves, DELAY_S, LAG_S, noises(2, len(moves)))
    assert excitation_of([rests, moved]).upper_hz == excitation_of([moved]).upper_hz > 0.0
    assert _identified_axis("a", Quantity.LENGTH, [rests, moved]).answer is not None


def test_a_ramp_over_the_whole_recording_is_fitted_or_refused_with_a_reason() -> None:
    """More than 95 % of the power of its speed is at no frequency at all."""
    ramp = np.concatenate((np.zeros(100), np.linspace(0.0, 60.0, 2900)))
    found = _identified_axis("a", Quantity.LENGTH, [trace(ramp, DELAY_S, LAG_S, 1e-3 * noises(0, 3000))])
    assert found.answer is not None or found.refused


def test_measurements_with_a_gap_where_some_are_kept_out_are_refused() -> None:
    """A bus was lost after a second, and came back for the last one: no error of a model can be judged."""
    sent = exciting_commands(9, 30.0, 15.0, 120.0)
    whole = trace(sent, DELAY_S, LAG_S, noises(0, len(sent)))
    ends = np.r_[0:60, len(sent) - 60 : len(sent)]
    with pytest.raises(ContidError, match="gaps"):
        fit_axis([whole.picked(ends)])
