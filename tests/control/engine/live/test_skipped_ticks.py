"""Rows come by a clock that goes on while ticks are skipped: a robot makes up for them, on its path."""

from __future__ import annotations

import numpy as np
import pytest

from tests.control.engine.streamed import CIRCLE_M, Run, circle, middle, rows_of

#: Ticks that are skipped, and that run before the next ones are.
PATTERNS = {
    "a stall of 45 ms twice a second": (9, 91),
    "100 ms once a second": (20, 180),
    "200 ms": (40, 400),
    "each third tick": (1, 2),
    "each sixth tick": (1, 5),
}


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_a_stream_stays_on_its_path_whatever_ticks_are_skipped(pattern: str, rate_hz: float) -> None:
    skipped, between = PATTERNS[pattern]
    run = Run("finger")
    at = circle(run, CIRCLE_M)
    run.at_rest_on(at(0.0))
    process, period_s = run.process, run.config.period_s
    began, rows = process.tick, list(rows_of(at, rate_hz, 0.0, seconds=4.0))
    x, y, _ = middle(run)
    next_skip, limited = 200, 0.0
    off_m: list[float] = []
    steps_m: list[float] = []
    last = np.array(at(0.0))
    while process.tick - began < 780:
        if process.tick - began >= next_skip:
            process.tick, process.skipped = process.tick + skipped, process.skipped + skipped
            next_skip = process.tick - began + between
        while rows and rows[0][0] <= (process.tick - began) * period_s:
            run.row(rows.pop(0)[1])
        run.tick()
        if process.tick - began < 150:  # the stream begins from rest
            limited = run.engine.robots.tallies[0].limited.total()
        tip = np.array(run.config.model.forward(run.engine.robots.states[0].command).tip_m)
        off_m.append(abs(float(np.hypot(tip[0] - x + CIRCLE_M, tip[1] - y)) - CIRCLE_M))
        steps_m.append(float(np.linalg.norm(tip - last)))
        last = tip
    assert max(off_m[150:]) < 5e-5
    assert max(steps_m) / period_s < 0.03  # of 16 mm/s; it was up to 0.1
    assert run.engine.robots.tallies[0].limited.total() <= limited + 1
