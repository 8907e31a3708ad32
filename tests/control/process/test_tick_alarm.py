"""The alarm of a tick on a machine on which it waits for a processor most of the time."""

from __future__ import annotations

import time

import pytest

from contid.control.engine.tick_costs import TickCosts, UnansweredError
from contid.control.process.tick_alarm import ALARMS, LONGEST_S, TickAlarm


class BusyMachine:
    """Alarms at equal distances, between which the tick waits for a processor for some of the time."""

    def __init__(self, passed_s: float, waited_s: float) -> None:
        self.alarms = 0
        self.costs = TickCosts(lambda: self.alarms * passed_s, 1, [])
        self._alarm = TickAlarm(self.costs, lambda: self.alarms * waited_s, 200.0)
        self.costs.begin(0)

    def ring(self, most: int) -> None:
        while self.alarms < most:
            self.alarms += 1
            self._alarm.ring(0, None)


@pytest.fixture(autouse=True)
def computes_nothing_in_c(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "thread_time", lambda: 0.0)


@pytest.mark.parametrize(("passed_s", "waited_s"), [(0.025, 0.0), (0.5, 0.45), (5.0, 4.9)])
def test_a_tick_is_interrupted_when_it_has_had_its_time(passed_s: float, waited_s: float) -> None:
    machine = BusyMachine(passed_s, waited_s)
    with pytest.raises(UnansweredError):
        machine.ring(20)
    had_s = machine.alarms * (passed_s - waited_s)
    assert machine.alarms >= 2
    assert had_s <= LONGEST_S + ALARMS * (passed_s - waited_s)


def test_a_tick_that_only_waits_is_not_interrupted() -> None:
    machine = BusyMachine(0.5, 0.5)
    machine.ring(100)
    assert machine.costs.running == 0
