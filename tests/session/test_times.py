"""Times of a run whose loop stood still: the clock, the ticks that ran, and the time of day."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from contid.control.engine.events.buses import TicksSkipped
from contid.control.engine.tick_layout import DEADLINE, SKIPPED, TICK
from contid.session.format.entries import Entry
from contid.session.read import Session
from contid_sessions.csv_files import export_channels, export_joined
from contid_sessions.info import summarize
from tests.session.runs import RUNS

#: The run waits here for as many periods, as while servos are armed.
WAITED_AT, WAITED = 80, 37
RATE_HZ = 200.0


class Waited(Session):
    """A session whose grid of deadlines was shifted in the middle."""

    def entries(self) -> Iterator[Entry]:
        shift_s = 0.0
        for entry in super().entries():
            if entry.values is not None:
                values = list(entry.values)
                shift_s = WAITED / RATE_HZ if values[TICK] >= WAITED_AT else 0.0
                values[DEADLINE] += shift_s
                entry = replace(entry, values=values)
            yield replace(entry, time_ns=entry.time_ns + round(shift_s * 1e9))


@pytest.fixture(scope="module")
def waited(tmp_path_factory: pytest.TempPathFactory) -> Waited:
    return Waited(RUNS["faulty_fingers"](tmp_path_factory.mktemp("session") / "run.mcap"))


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_the_summary_counts_waits_and_names_the_longest_gap(waited: Waited) -> None:
    info = summarize(waited)
    assert info.skipped > 0
    assert info.waited == WAITED
    assert info.longest_gap_ms == pytest.approx((WAITED + 1) / RATE_HZ * 1e3, abs=20.0)
    assert f"{WAITED} waited for arming, longest gap" in str(info)


def test_a_skip_is_the_longest_gap_of_a_run_without_waits(waited: Waited) -> None:
    info = summarize(Session(waited.path))
    assert info.waited == 0
    skips = [event for event in waited.events() if isinstance(event, TicksSkipped)]
    assert info.longest_gap_ms > 1e3 / RATE_HZ
    assert skips[-1].longest_gap_ms == pytest.approx(info.longest_gap_ms, abs=1e3 / RATE_HZ)


def test_tables_have_the_time_of_the_clock_of_the_robots_and_of_day(waited: Waited, tmp_path: Path) -> None:
    paths = export_channels(waited, tmp_path / "out")
    export_joined(waited, tmp_path / "all.csv")
    records = [entry for entry in waited.entries() if entry.values is not None]
    start_s = int(waited.metadata["clock"]["wall_ns"]) / 1e9
    for path in [*paths[:-1], tmp_path / "all.csv"]:
        rows = _rows(path)
        assert len(rows) == len(records)
        for row, entry in zip(rows, records, strict=True):
            assert entry.values is not None
            tick, skipped = entry.values[TICK], entry.values[SKIPPED]
            waits = WAITED if tick >= WAITED_AT else 0
            assert float(row["t_s"]) == pytest.approx((tick + waits) / RATE_HZ, abs=1e-9)
            assert float(row["robot_s"]) == pytest.approx((tick - skipped) / RATE_HZ, abs=1e-9)
            assert float(row["unix_s"]) == pytest.approx(start_s + (tick + waits) / RATE_HZ, abs=2e-6)
    events = _rows(paths[-1])
    for row in events:
        assert float(row["unix_s"]) - float(row["t_s"]) == pytest.approx(start_s, abs=2e-6)
