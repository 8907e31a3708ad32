"""What a run adds up, in constant memory."""

from __future__ import annotations

import pytest

from contid.control.tick.statistics import Lateness, RobotTally


def test_the_histogram_keeps_three_digits() -> None:
    lateness = Lateness()
    for us in range(1, 10_001):
        lateness.add((us + 0.5) * 1e-6)
    figures = lateness.as_dict()
    assert figures["p50_us"] == pytest.approx(5000, rel=0.01)
    assert figures["p99_us"] == pytest.approx(9900, rel=0.01)
    assert figures["max_us"] == pytest.approx(10_000.5)
    assert len(lateness.counts) < 2000


def test_the_tally_counts_what_was_followed() -> None:
    tally = RobotTally()
    tally.add(3e-6, True)
    tally.add(4e-6, False)
    report = tally.as_dict()
    assert report["tip_error_max_mm"] == pytest.approx(4e-3)
    assert report["tip_error_rms_mm"] == pytest.approx((12.5e-12) ** 0.5 * 1e3)
    assert (report["ticks_followed"], report["ticks_unreachable"]) == (2, 1)
