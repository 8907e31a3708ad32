"""What a run adds up, in constant memory."""

from __future__ import annotations

import math
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.control.tick.limits import ACCELERATION, POSITION, REFUSED, TENSION, VELOCITY
from contid.control.tick.statistics import Lateness, RobotTally


def test_the_histogram_keeps_three_digits() -> None:
    lateness = Lateness()
    for us in range(1, 10_001):
        lateness.add((us + 0.5) * 1e-6)
    figures = lateness.as_dict()
    assert figures["p50_us"] == pytest.approx(5000, rel=0.01)
    assert figures["p99_us"] == pytest.approx(9900, rel=0.01)
    assert figures["p99_9_us"] == pytest.approx(9990, rel=0.002)
    assert figures["max_us"] == pytest.approx(10_000.5)
    assert len(lateness.counts) < 2000


@given(st.integers(0, 10_000_000))
def test_one_lateness_is_kept_to_a_microsecond_or_three_digits(us: int) -> None:
    lateness = Lateness()
    lateness.add((us + 0.5) * 1e-6)
    kept = lateness.quantile_us(0.5)
    assert kept <= us < kept + max(1.0, 0.01 * us)
    assert kept == us or us > 999
    assert not str(int(kept))[3:].strip("0")
    assert lateness.as_dict()["max_us"] == us + 0.5


def test_a_quantile_is_the_least_that_so_large_a_share_did_not_exceed() -> None:
    lateness = Lateness()
    assert lateness.quantile_us(0.5) == 0.0
    for us in (10, 20, 30, 40):
        lateness.add((us + 0.5) * 1e-6)
    assert [lateness.quantile_us(share) for share in (0.25, 0.5, 0.51, 0.75, 1.0)] == [10, 20, 30, 30, 40]
    lateness.add(5e-6)
    assert lateness.as_dict()["max_us"] == 40.5


def test_the_tally_counts_what_was_followed() -> None:
    tally = RobotTally()
    tally.add(4e-6, False, 2e-6)
    tally.add(3e-6, True, 1e-6)
    report = tally.as_dict()
    assert report["tip_error_max_mm"] == pytest.approx(4e-3)
    assert report["tip_error_rms_mm"] == pytest.approx((12.5e-12) ** 0.5 * 1e3)
    assert report["ik_residual_max_mm"] == pytest.approx(2e-3)
    assert (report["ticks_followed"], report["ticks_unreachable"]) == (2, 1)
    nothing = RobotTally().as_dict()
    assert [value for value in nothing.values() if value] == []


def test_ticks_are_counted_for_every_limit_that_bound() -> None:
    limited = Counter({VELOCITY | ACCELERATION: 3, VELOCITY: 2, TENSION: 1, POSITION | TENSION: 4})
    ticks = RobotTally(limited=limited).as_dict()["ticks_limited"]
    assert ticks == {"velocity": 5, "acceleration": 3, "tension": 5, "position": 4}
    assert len({POSITION, VELOCITY, ACCELERATION, REFUSED, TENSION}) == 5


def test_a_target_out_of_reach_leaves_only_the_last_tick_to_count() -> None:
    tally = RobotTally()
    tally.on_path(0.0, False, True, 1.0)
    tally.on_path(5e-3, False, True, 1.0)
    assert tally.off_target_m == 5e-3
    tally.off_path(2e-3)
    assert tally.off_target_m == 2e-3
    tally.on_path(1e-3, True, True, 1.0)  # it has to catch up first
    assert (tally.off_target_m, tally.off_m) == (1e-3, 5e-3)
    tally.on_path(-1.0, False, True, 1.0)  # nearer than the residual
    assert tally.off_target_m == 0.0
    tally.missed(3e-3)
    tally.missed(2e-3)
    assert tally.off_target_m == 3e-3


def test_a_robot_that_joins_again_has_to_catch_up_again() -> None:
    tally = RobotTally()
    assert tally.joined_s == -math.inf
    tally.on_path(0.0, False, True, 1.0)
    tally.on_path(1e-3, True, True, 2.0)
    assert tally.off_m == 0.0
    tally.on_path(0.0, False, True, 2.0)
    tally.on_path(1e-3, True, True, 2.0)
    tally.on_path(0.5e-3, True, True, 2.0)
    assert tally.off_m == 1e-3
