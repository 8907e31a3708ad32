"""Rows come by a clock that goes on while ticks are skipped: a robot makes up for them, on its path."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import repeat

import numpy as np
import pytest

from tests.control.engine.streamed import CIRCLE_M, Run, circle, middle, rows_of

#: Ticks that are skipped, and that run before the next ones are.
PATTERNS = {
    "a stall of 45 ms twice a second": (9, 91),
    "100 ms once a second": (20, 180),
    "100 ms thrice in two seconds": (20, 113),
    "150 ms thrice in three seconds": (30, 150),
    "190 ms twice in two seconds": (38, 150),
    "each third tick": (1, 2),
    "each sixth tick": (1, 5),
}


def skips_of(skipped: int, between: int) -> Iterator[int]:
    """From the 200th tick on."""
    yield from repeat(0, 200)
    while True:
        yield skipped
        yield from repeat(0, between - 1)


@pytest.mark.parametrize(
    ("pattern", "rate_hz"),
    [
        # Each pattern with one rate, and each rate with two patterns or more.
        pytest.param(pattern, rate_hz, marks=() if number % 3 == place else pytest.mark.campaign)
        for number, pattern in enumerate(PATTERNS)
        for place, rate_hz in enumerate((50.0, 100.0, 200.0))
    ],
)
def test_a_stream_stays_on_its_path_whatever_ticks_are_skipped(pattern: str, rate_hz: float) -> None:
    run = Run("finger")
    at = circle(run, CIRCLE_M)
    run.at_rest_on(at(0.0))
    rows = list(rows_of(at, rate_hz, 0.0, seconds=4.0))
    followed = run.follow(rows, 2.75, skips_of(*PATTERNS[pattern]))
    x, y, _ = middle(run)
    begun = 150  # the stream begins from rest
    radii = np.hypot(followed.tip_m[begun:, 0] - x + CIRCLE_M, followed.tip_m[begun:, 1] - y)
    assert np.abs(radii - CIRCLE_M).max() < 5e-5
    steps_m = np.linalg.norm(np.diff(followed.tip_m, axis=0), axis=1)
    assert steps_m.max() / run.config.period_s < 0.03  # of 16 mm/s; it was up to 0.1
    assert followed.limited[begun:].sum() <= 1
