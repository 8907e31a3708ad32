"""The correction of a robot without a target: measurements that are old and seldom do not wear it away."""

from __future__ import annotations

import math

import pytest

from contid.control.tick.config import FeedbackConfig
from contid.control.tick.tip_feedback import Correction, Measurement, kept

TICK_S, STALE_S, FADE_S = 0.005, 0.1, 0.3
FEEDBACK = FeedbackConfig(2.0, 0.02, STALE_S, FADE_S)
ERROR_M = (0.01, 0.0, 0.0)


def errors_m(every_ticks: int, age_s: float, ends_s: float = math.inf, rules: int = 5) -> list[float]:
    correction = Correction(ERROR_M, ERROR_M, 0.0, ERROR_M)
    measured = Measurement((0.0, 0.0, 0.0), -age_s)
    out = []
    for tick in range(600):
        now_s = tick * TICK_S
        if tick % every_ticks == 0 and now_s < ends_s:
            measured = Measurement((0.0, 0.0, 0.0), now_s - age_s)
        correction = kept(FEEDBACK, correction, now_s, measured, rules)
        out.append(correction.error_m[0])
    return out


def test_a_correction_is_whole_with_every_measurement() -> None:
    """Ten a second that are 95 ms old: each is too old for a part of the time until the next."""
    errors = errors_m(20, 0.095)
    assert errors[20::20] == [0.01] * 29
    assert min(errors) > 0.5 * 0.01


def test_a_correction_fades_where_no_measurement_comes() -> None:
    errors = errors_m(20, 0.095, ends_s=1.0)
    assert errors[round((0.9 - 0.095 + STALE_S + FADE_S) / TICK_S) + 2 :] == pytest.approx(
        [0.0] * (600 - round((0.9 - 0.095 + STALE_S + FADE_S) / TICK_S) - 2), abs=1e-12
    )


def test_recordings_of_earlier_rules_replay_by_them() -> None:
    """Each measurement went on from the part that was left."""
    errors = errors_m(20, 0.095, rules=4)
    assert errors[200] < 0.5 * 0.01
