"""The least delay of a contact, against detectors that are simulated measurement by measurement."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sense.contact_bound import FALSE_ALARMS, LATENCY_S, SIGMA_MM, TRACKER_HZ, delays_s


@pytest.mark.parametrize("speed_mm_s", [6.4, 20.0, 69.0])
def test_a_simulated_detector_that_is_given_everything_is_as_late(speed_mm_s: float) -> None:
    rng = np.random.default_rng(4)
    first_s = rng.uniform(0.0, 1.0 / TRACKER_HZ, (4000, 1))
    times_s = first_s + np.arange(20) / TRACKER_HZ
    held_mm = speed_mm_s * times_s
    # Log likelihood ratio of the first n measurements; its gate from simulated measurements without a wall.
    score = np.cumsum(held_mm * (held_mm + SIGMA_MM * rng.normal(size=held_mm.shape)), axis=1)
    score /= SIGMA_MM * np.sqrt(np.cumsum(held_mm**2, axis=1))
    noise = rng.normal(size=2_000_000)
    gate = np.quantile(noise, 1.0 - 1e-4)
    assert gate == pytest.approx(3.72, abs=0.05)
    late_s = delays_s(speed_mm_s, false_alarms=1e-4)
    for level in (0.25, 0.5, 0.75):
        at_s = np.quantile(late_s, level) - LATENCY_S
        # Share of the runs whose measurements up to then pass the gate.
        last = np.floor((at_s - first_s[:, 0]) * TRACKER_HZ).astype(int)
        passed = np.where(last >= 0, score[np.arange(len(score)), np.maximum(last, 0)] > gate, False)
        assert passed.mean() == pytest.approx(level, abs=0.05)
    assert np.median(delays_s(speed_mm_s)) > np.median(late_s)
    assert pytest.approx(1.0 / 180_000) == FALSE_ALARMS
