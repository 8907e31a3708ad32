"""Ticks that do not fit slow down in a fixed order, which is reported once, and come back when they fit."""

from __future__ import annotations

import numpy as np
import pytest

from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import OverloadChanged, TicksSkipped
from contid.control.process.pace import Pace
from contid.control.process.slowdown import CALM_S, RAMP_S, WINDOW_S

RATE_HZ = 200.0
PERIOD_S = 1.0 / RATE_HZ


class Loop:
    """A loop whose ticks take a given time, on a clock of its own."""

    def __init__(self, longest_s: float = 1.0) -> None:
        self.now_s, self.work_s, self.late_s = 0.0, 0.0, 0.0
        self.reported: list[OverloadChanged] = []
        self.starts_s: list[float] = []
        self.skipped = 0
        self.pace = Pace(RATE_HZ, 0.0, self, worked=lambda: self.work_s, longest_s=longest_s)

    def write(self, values: list[float]) -> None:
        raise AssertionError("Pace must not write records")

    def event(self, event: RunEvent) -> None:
        if isinstance(event, OverloadChanged):
            self.reported.append(event)
        else:
            assert isinstance(event, TicksSkipped)

    def run(self, seconds: float, work_s: float, late_s: float = 0.0) -> int:
        """Ticks for a time; returns how many were skipped in it."""
        self.work_s, before, ends_s = work_s, self.skipped, self.now_s + seconds
        while self.now_s < ends_s:
            self.now_s = max(self.now_s, self.pace.deadline_s) + late_s
            timing = self.pace.begin(self.now_s, preparing=False)
            self.starts_s.append(self.now_s)
            self.skipped = timing.skipped
            self.now_s += work_s
        return self.skipped - before


def test_ticks_that_fit_change_nothing() -> None:
    loop = Loop()
    assert loop.run(10.0, 0.9 * PERIOD_S) == 0
    assert not loop.reported


@pytest.mark.parametrize(("periods", "levels"), [(1.3, [1, 2]), (1.9, [1, 2]), (3.5, [1, 2, 3])])
def test_telemetry_gives_way_first_then_the_rate_until_no_tick_is_skipped(
    periods: float, levels: list[int]
) -> None:
    loop = Loop()
    loop.run(len(levels) * 2.0 * WINDOW_S + 2.0 * RAMP_S + 2.0, periods * PERIOD_S)
    assert [event.level for event in loop.reported] == levels
    assert loop.reported[-1].rate_hz == RATE_HZ / 2.0 ** (levels[-1] - 1)
    assert f"{RATE_HZ:g} Hz" in str(loop.reported[-1])
    assert loop.run(10.0, periods * PERIOD_S) == 0
    assert len(loop.reported) == len(levels)  # one report each


def test_the_period_changes_by_a_ramp_and_ends_at_twice_its_length() -> None:
    loop = Loop()
    loop.run(6.0, 1.2 * PERIOD_S)
    del loop.starts_s[:]
    loop.run(2.0, 1.2 * PERIOD_S)
    assert np.diff(loop.starts_s) == pytest.approx(2.0 * PERIOD_S, rel=1e-6)
    loop.run(2.0 * CALM_S, 0.1 * PERIOD_S)
    intervals = np.diff(loop.starts_s)
    assert loop.reported[-1].level < 2
    assert intervals[-1] == pytest.approx(PERIOD_S, rel=1e-6)
    # A robot at full speed speeds up within RAMP_S, not within a tick.
    assert np.abs(np.diff(intervals)).max() <= 2.1 * PERIOD_S**2 / RAMP_S


def test_it_comes_back_step_by_step_and_waits_longer_after_each_return() -> None:
    loop = Loop()
    calm_s = []
    for _ in range(3):
        loop.run(8.0, 1.5 * PERIOD_S)
        assert loop.reported[-1].level == 2
        began_s = loop.now_s
        while loop.reported[-1].level:
            loop.run(0.5, 0.2 * PERIOD_S)
        calm_s.append(loop.now_s - began_s)
    assert calm_s[0] < 3.0 * CALM_S < calm_s[1] < calm_s[2]
    assert [event.level for event in loop.reported] == 3 * [1, 2, 1, 0]


def test_a_busy_machine_thins_telemetry_and_does_not_slow_robots() -> None:
    loop = Loop()
    loop.run(10.0, 0.2 * PERIOD_S, late_s=1.5 * PERIOD_S)
    assert [event.level for event in loop.reported] == [1]


def test_one_pause_is_no_overload() -> None:
    loop = Loop()
    for _ in range(3):
        loop.run(3.0, 0.5 * PERIOD_S)
        loop.now_s += 0.5
    assert not loop.reported


def test_watchdogs_of_devices_bound_the_period() -> None:
    loop = Loop(longest_s=2.5 * PERIOD_S)
    loop.run(20.0, 3.5 * PERIOD_S)
    assert [event.level for event in loop.reported] == [1, 2]
