"""The board's clock on the host's: random latencies, two crystals that drift, the wrap after 49 days."""

from __future__ import annotations

import random
from collections import deque

import pytest

from contid_drivers.due.session import DRIFT, BoardClock


@pytest.mark.parametrize("drift", [0.0, 60e-6, -60e-6])
@pytest.mark.parametrize("begin_ms", [0, 12_345, (1 << 32) - 700])
def test_samples_are_placed_within_half_of_a_short_round_trip(drift: float, begin_ms: int) -> None:
    dice, clock = random.Random(3), BoardClock()
    trips: deque[tuple[float, float]] = deque(maxlen=100)
    for k in range(2000):
        asked_s = 100.0 + 0.01 * k
        composed_s = asked_s + dice.uniform(0.0002, 0.0012)
        received_s = composed_s + dice.uniform(0.0002, 0.0012) + (0.02 if dice.random() < 0.05 else 0.0)
        board_us = round(begin_ms * 1000 + (composed_s - 100.0) * (1 + drift) * 1e6)
        uptime_ms, age_us = divmod(board_us, 1000)
        clock.update(uptime_ms % (1 << 32), age_us, asked_s, received_s)
        truth_s = composed_s - age_us / 1e6
        trips.append((received_s, received_s - asked_s))
        bound_s = min(trip / 2 + DRIFT * (received_s - at) for at, trip in trips)
        # The margin: a microsecond of resolution, and numbers of 50 days in double precision.
        assert abs(clock.sampled_s - truth_s) <= bound_s + 5e-6
    assert bound_s < 0.0005


def test_a_board_that_started_anew_is_mapped_anew() -> None:
    clock = BoardClock()
    clock.update(50_000, 100, 1.0, 1.001)
    clock.update(20, 0, 2.0, 2.001)
    assert 1.9999 <= clock.sampled_s <= 2.0011
