"""Filling and venting: found again from a chamber that another integrator moves."""

from __future__ import annotations

import numpy as np
import pytest

from contid_identify.answer import CommandedTrace
from contid_identify.delay_lag import fit_axis

PERIOD_S = 0.02
DELAY_S, FILL_S, VENT_S, FILLS, VENTS = 0.2, 0.35, 0.6, 18.0, 6.0


def test_lags_and_greatest_speeds_of_a_chamber() -> None:
    draw = np.random.default_rng(4)
    sent = np.repeat(draw.uniform(0.0, 15.0, 24), 125)
    step_s, x, measured = 1e-3, float(sent[0]), []
    fine = np.repeat(sent, round(PERIOD_S / step_s))
    late = np.concatenate([np.full(round(DELAY_S / step_s), sent[0]), fine])
    for k in range(len(fine)):
        if k % 40 == 0:
            measured.append(x)
        gap = late[k] - x
        x += step_s * float(np.clip(gap / (FILL_S if gap > 0.0 else VENT_S), -VENTS, FILLS))
    noisy = np.array(measured)[:, None] + draw.normal(0.0, 0.03, (len(measured), 1))
    found = fit_axis(
        [CommandedTrace(PERIOD_S, sent, np.arange(len(measured), dtype=np.float64) * 40.0 * step_s, noisy)]
    )
    own = found.filling
    assert own is not None
    assert own.delay_s.value == pytest.approx(DELAY_S, abs=0.01)
    assert own.fill_lag_s.value == pytest.approx(FILL_S, rel=0.1)
    assert own.vent_lag_s.value == pytest.approx(VENT_S, rel=0.1)
    assert own.fill_per_s.value == pytest.approx(FILLS, rel=0.1)
    assert own.vent_per_s.value == pytest.approx(VENTS, rel=0.05)
    assert found.stages[3].kept_out.rmse < 0.06 < 0.2 * found.stages[2].kept_out.rmse
