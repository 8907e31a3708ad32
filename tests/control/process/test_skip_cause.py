"""Skipped ticks are reported with what took the time."""

from __future__ import annotations

import pytest

from contid.control.engine.events.buses import TicksSkipped
from contid.control.engine.tick_costs import TickCosts
from contid.control.process.pace import REPORT_INTERVAL_S, Pace
from contid.control.process.skip_cause import PASSES, ProcessorSpeed, SkipCause
from tests.support.fingers import Collector


class Working:
    """A port whose worker has been at a job for some time."""

    def __init__(self, job_s: float) -> None:
        self._job_s = job_s

    def job_s(self, now_s: float) -> float:
        return self._job_s


#: Durations in ms: rows and orders before it, the model of a, the exchange of bus x in the tick, a late
#: wake-up, time that the thread ran, that it waited for a processor, and that the worker of y had a job.
CASES = [
    ((0, 20, 0, 0, 20, 0, 0), "robot a: its model took 20 ms"),
    ((0, 20, 0, 0, 0, 0, 0), "robot a: its model took 20 ms"),
    ((0, 0, 20, 0, 1, 0, 0), "bus x: its exchange took 20 ms"),
    ((0, 20, 0, 0, 1, 0, 21), "bus y: its driver held the interpreter for 19 ms"),
    ((0, 0, 0, 20, 0, 0, 22), "bus y: its driver held the interpreter for 20 ms"),
    ((0, 0, 0, 20, 0, 0, 5), "the machine: a late wake-up took 20 ms"),
    ((0, 0, 0, 20, 0, 19, 22), "the machine is busy: contid waited 19 ms for a processor"),
    ((0, 20, 0, 0, 2, 18, 0), "the machine is busy: contid waited 18 ms for a processor"),
    ((0, 0, 0, 0, 20, 0, 0), "the loop itself took 20 ms"),
    ((20, 0, 0, 0, 20, 0, 0), "rows and orders took 20 ms"),
    ((20, 0, 0, 0, 1, 0, 20), "bus y: its driver held the interpreter for 19 ms"),
]


@pytest.mark.parametrize(("took_ms", "words"), CASES)
def test_the_cause_is_named(took_ms: tuple[int, ...], words: str) -> None:
    orders_s, model_s, bus_s, late_s, ran_s, waited_s, job_s = (each * 1e-3 for each in took_ms)
    costs = TickCosts(lambda: 0.0, 2, ("x", "y"))
    costs.robots_s, costs.buses_s["x"] = [model_s, 0.0], bus_s
    costs.began_s = orders_s
    spent_s = max(orders_s + model_s + bus_s, 0.0 if late_s else ran_s)
    costs.ended_s, due_s = spent_s, 0.005
    times = {"ran": 0.0, "waited": 0.0}
    ports = {"x": Working(0.0), "y": Working(job_s)}
    cause = SkipCause(costs, ["a", "b"], ports, lambda: times["waited"], lambda: times["ran"], lambda: 1.0)  # type: ignore[arg-type]
    cause.begin()
    times |= {"ran": ran_s, "waited": waited_s}
    assert cause.find(max(spent_s, due_s + late_s), due_s) == words


def test_a_processor_whose_clock_is_lowered_is_the_cause() -> None:
    """What computes then takes longer, and nothing waits."""
    costs, clock_s, pass_s = TickCosts(lambda: 0.0, 1, ()), [0.0], 1e-8

    def now() -> float:
        """Every second look ends the passes between."""
        clock_s[0] += 0.5 * PASSES * pass_s
        return clock_s[0]

    cause = SkipCause(costs, ["a"], {}, lambda: 0.0, lambda: 0.0, ProcessorSpeed(now))
    for slower, words in (
        (1.0, "robot a: its model took 20 ms"),
        (12.5, "the machine: its processor ran at 8 % of its speed"),
    ):
        cause.begin()
        pass_s = slower * 1e-8
        costs.robots_s, costs.ended_s = [0.02], 0.02
        assert cause.find(0.02, 0.005) == words


def test_an_event_has_the_cause_of_the_longest_gap_since_the_one_before() -> None:
    sink, causes = Collector(), iter(["short", "long", "later"])
    pace = Pace(100.0, 0.0, sink, lambda start_s, due_s: next(causes))
    pace._reported_s = 0.0
    for missed in (1, 3, 2):
        pace.begin(pace.deadline_s + (missed + 0.5) / 100.0, preparing=False)
    assert not sink.events
    for _ in range(round(100 * REPORT_INTERVAL_S)):
        pace.begin(pace.deadline_s, preparing=False)
    (event,) = sink.events
    assert (event["ticks"], event["cause"]) == (6, "long")
    text = str(TicksSkipped(ticks=1, total=7, cause="robot a: its model took 20 ms"))
    assert text == "1 tick skipped (7 in all): robot a: its model took 20 ms"
