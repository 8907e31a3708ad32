"""A writer, or the machine with it, stands still amid a stream: the robot stays on its path.

The path of the rows is known in closed form, and the stalls come from the clock of the test alone.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator, Sequence
from itertools import product, repeat

import numpy as np
import pytest

from tests.control.engine.streamed import CIRCLE_M, Row, Run, circle, middle, rows_of

#: When a stall begins [s].
STALLS_S = (1.0, 1.9, 2.8)
#: Ticks that run before the rows of a stall of the machine come.
SLOW_TICKS = 3


class Late(enum.Enum):
    """How rows come that a stall held back."""

    TOGETHER = enum.auto()
    IN_TURN = enum.auto()  # 2 ms after each other
    ON = enum.auto()  # and all after them as much later: the writer waited


def held(rows: Sequence[Row], held_s: float, late: Late) -> Iterator[Row]:
    before_s = 0.0
    for written_s, tip_m in rows:
        stalls = [begun_s for begun_s in STALLS_S if begun_s <= written_s]
        if late is Late.ON:
            come_s = written_s + held_s * len(stalls)
        else:
            come_s = max([written_s, *[begun_s + held_s for begun_s in stalls]])
        before_s = max(come_s, before_s + 0.002) if late is Late.IN_TURN else come_s
        yield before_s, tip_m


def skips_of(stalled_s: float, period_s: float) -> Iterator[int]:
    """Ticks that are skipped before each, as the machine stands still in `STALLS_S`."""
    ticks, stalls, skipped = 0, list(STALLS_S), round(stalled_s / period_s) - SLOW_TICKS
    while True:
        stands = bool(stalls) and ticks * period_s >= stalls[0]
        if stands:
            stalls.pop(0)
        ticks += 1 + stands * skipped
        yield stands * skipped


CASES = list(product([False, True], Late, [20.0, 50.0, 100.0, 200.0, 333.0], [0.06, 0.11, 0.15, 0.19]))
SHORT = [case for case in CASES if case[2:] == ((50.0, 0.15) if case[0] else (333.0, 0.11))]


@pytest.mark.parametrize(
    ("machine", "late", "rate_hz", "held_s"),
    [pytest.param(*case, marks=() if case in SHORT else pytest.mark.campaign) for case in CASES],
)
def test_a_stream_stays_on_its_path_when_writer_or_machine_stood_still(
    machine: bool, late: Late, rate_hz: float, held_s: float
) -> None:
    run = Run("finger")
    at = circle(run, CIRCLE_M)
    run.at_rest_on(at(0.0))
    rows = list(held(list(rows_of(at, rate_hz, 0.0)), held_s, late))
    skips = skips_of(held_s, run.config.period_s) if machine else repeat(0)
    followed = run.follow(rows, 3.5, skips)
    begun = 150  # the stream begins from rest
    x, y, _ = middle(run)
    radii = np.hypot(followed.tip_m[begun:, 0] - x + CIRCLE_M, followed.tip_m[begun:, 1] - y)
    assert np.abs(radii - CIRCLE_M).max() < 5e-5
    steps_m = np.linalg.norm(np.diff(followed.tip_m, axis=0), axis=1)
    assert steps_m.max() / run.config.period_s < 0.03  # of 16 mm/s; it was up to 0.2
    assert followed.limited[begun:].sum() <= 12
    assert run.rates(followed)[2] <= 1.0 + 1e-6
