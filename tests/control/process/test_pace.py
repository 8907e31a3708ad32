"""The grid of deadlines: skipped ticks are not repeated, and every period is counted."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.control.engine.events import RunEvent
from contid.control.engine.events.json_form import to_json
from contid.control.process.pace import REPORT_INTERVAL_S, START_PERIODS, Pace

RATE_HZ = 100.0
PERIOD_S = 1.0 / RATE_HZ


class Events:
    """Collects events."""

    def __init__(self) -> None:
        self.events: list[dict[str, Any]] = []

    def write(self, values: list[float]) -> None:
        raise AssertionError("Pace must not write records")

    def event(self, event: RunEvent) -> None:
        self.events.append(to_json(event))


def test_ticks_in_time_are_one_period_apart() -> None:
    pace = Pace(RATE_HZ, 10.0, Events())
    for number in range(50):
        timing = pace.begin(pace.deadline_s, preparing=False)
        assert timing.tick == number
        assert timing.deadline_s == pytest.approx(10.0 + (START_PERIODS + number) * PERIOD_S)
        assert timing.lateness_s == 0.0
    report = pace.report()
    assert (report.ticks, report.late, report.skipped, report.waited) == (50, 0, 0, 0)
    assert report.longest_gap_ms == 0.0


def test_a_late_tick_does_not_shift_the_grid() -> None:
    pace = Pace(RATE_HZ, 0.0, Events())
    due_s = pace.deadline_s
    timing = pace.begin(due_s + 0.6 * PERIOD_S, preparing=False)
    assert (timing.tick, timing.skipped) == (0, 0)
    assert timing.lateness_s == pytest.approx(0.6 * PERIOD_S)
    assert pace.deadline_s == pytest.approx(due_s + PERIOD_S)
    assert pace.report().late == 1


def test_missed_deadlines_are_skipped_but_shift_the_grid_during_preparation() -> None:
    sink, waits = Events(), Events()
    counting, arming = Pace(RATE_HZ, 0.0, sink), Pace(RATE_HZ, 0.0, waits)
    start_s = counting.deadline_s + 3.25 * PERIOD_S + 2.0 * REPORT_INTERVAL_S
    missed = 3 + round(2.0 * REPORT_INTERVAL_S * RATE_HZ)
    skipped, waited = counting.begin(start_s, preparing=False), arming.begin(start_s, preparing=True)
    assert (skipped.tick, skipped.skipped) == (missed, missed)
    assert (waited.tick, waited.skipped) == (0, 0)
    assert skipped.lateness_s == pytest.approx(waited.lateness_s) == pytest.approx(0.25 * PERIOD_S)
    assert counting.deadline_s == pytest.approx(arming.deadline_s)
    gap_ms = round((start_s - 0.0) * 1e3, 3)
    counts = {"ticks": missed, "total": missed, "longest_gap_ms": gap_ms}
    assert sink.events == [{"event": "skipped", **counts, "cause": ""}]
    assert waits.events == [{"event": "waited", **counts}]
    assert counting.report().longest_gap_ms == arming.report().longest_gap_ms == gap_ms
    # The histogram holds the delay of skipped ticks completely, and without the shift of the grid.
    assert counting.report().lateness["max_us"] == pytest.approx(
        (start_s - START_PERIODS * PERIOD_S) * 1e6, abs=0.1
    )
    assert arming.report().lateness["max_us"] == pytest.approx(0.25 * PERIOD_S * 1e6, abs=0.1)


def test_ticks_skipped_soon_after_a_report_are_reported_later() -> None:
    sink = Events()
    pace = Pace(RATE_HZ, 0.0, sink)
    pace.begin(pace.deadline_s + 1.5 * PERIOD_S + 2.0 * REPORT_INTERVAL_S, preparing=False)
    pace.begin(pace.deadline_s + 2.5 * PERIOD_S, preparing=False)
    assert len(sink.events) == 1
    for _ in range(round(REPORT_INTERVAL_S * RATE_HZ)):
        pace.begin(pace.deadline_s, preparing=False)
    assert [event["ticks"] for event in sink.events][1:] == [2]
    assert sink.events[-1]["total"] == pace.report().skipped


@pytest.mark.parametrize("preparing", [False, True])
def test_periods_missed_between_two_reports_are_added_up(preparing: bool) -> None:
    sink = Events()
    pace = Pace(RATE_HZ, 0.0, sink)
    pace.begin(pace.deadline_s + 1.5 * PERIOD_S + 2.0 * REPORT_INTERVAL_S, preparing)
    for missed in (2, 3):
        pace.begin(pace.deadline_s + (missed + 0.5) * PERIOD_S, preparing)
    assert len(sink.events) == 1
    for _ in range(round(REPORT_INTERVAL_S * RATE_HZ)):
        pace.begin(pace.deadline_s, preparing=False)
    first, second = sink.events
    assert second["ticks"] == 2 + 3
    assert second["total"] == first["total"] + 2 + 3


@given(st.lists(st.tuples(st.floats(0.0, 0.2), st.booleans()), max_size=40))
def test_every_deadline_is_run_skipped_or_waited_for(delays: list[tuple[float, bool]]) -> None:
    pace = Pace(RATE_HZ, 0.0, Events())
    base_s = pace.deadline_s
    last = -1
    for delay_s, preparing in delays:
        timing = pace.begin(pace.deadline_s + delay_s, preparing)
        assert timing.tick > last
        assert 0.0 <= timing.lateness_s < PERIOD_S * (1.0 + 1e-9)
        last = timing.tick
    report = pace.report()
    passed = round((pace.deadline_s - base_s) * RATE_HZ)
    assert report.ticks + report.skipped + report.waited == passed
