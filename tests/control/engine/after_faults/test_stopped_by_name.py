"""Robots that are stopped by name, as in the panel, or by a fault: where their trajectory goes on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import pytest

from contid.control.engine.messages import ClearFault, Estop, Hold, Message, Resume, Stop
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.supervisor import Mode
from tests.support.fingers import Collector, circle, load, run_virtual

F0, F1 = ("f0",), ("f1",)
#: A tick in the middle of the circle, one after the circle would have ended, and the last one of the run.
STOPPED, RESUMED, LAST = 250, 700, 1250


def run(count: int, orders: Mapping[int, Sequence[Message]]) -> Collector:
    """A circle of 2 s with orders by tick."""
    loaded = load(count)
    collector = Collector(loaded)
    path = circle(loaded, period_s=2.0)
    run_virtual(loaded, 200.0, path, sinks=[collector], orders=orders, ticks=LAST)
    return collector


def off_the_circle_m(collector: Collector, robot: int) -> float:
    """Greatest distance of a commanded tip from the circle, from the first tick in RUN to the last one."""
    config = build_robot_configs(load(robot + 1), 200.0)[robot]
    records = collector.records
    first = next(k for k, record in enumerate(records) if record.robots[robot].mode == Mode.RUN)
    most = 0.0
    for record in records[first:]:
        axes = tuple(axis.command for axis in record.robots[robot].axes)
        if all(map(math.isfinite, axes)):
            tip = config.frame.point_in_world(config.model.forward(axes).tip_m)
            most = max(most, abs(math.hypot(tip[0] - 0.05, tip[1] - 0.075) - 0.005))
    return most


@pytest.mark.parametrize(
    ("stop", "goes_on"),
    [
        (Hold, F0),
        (Stop, None),
        (Estop, F0),
        *(
            pytest.param(*each, marks=pytest.mark.campaign)
            for each in ((Hold, None), (Stop, F0), (Estop, None))
        ),
    ],
)
def test_the_only_robot_stopped_by_its_name_goes_on_where_it_stopped(
    stop: type[Hold] | type[Stop] | type[Estop], goes_on: tuple[str, ...] | None
) -> None:
    went = run(1, {STOPPED: [stop(F0)], RESUMED: [Resume(goes_on)]})
    times = {record.tick: record.source_s for record in went.records}
    assert times[STOPPED + 10] == times[RESUMED]
    assert off_the_circle_m(went, 0) < 2e-4, "its way from one place of the path to a later one is none"
    assert [event["event"] for event in went.events if event["event"] in ("end", "stopping")] == [
        "end",
        "stopping",
    ]


def test_a_robot_stopped_by_its_name_does_not_end_the_run_with_its_path_undone() -> None:
    went = run(1, {STOPPED: [Hold(F0)]})
    assert not [event for event in went.events if event["event"] in ("end", "stopping")]
    assert went.records[-1].tick == LAST - 1


def test_a_robot_stopped_with_all_and_resumed_by_its_name_goes_on() -> None:
    went = run(1, {STOPPED: [Hold()], RESUMED: [Resume(F0)]})
    assert [event["event"] for event in went.events if event["event"] == "end"] == ["end"]


def test_robots_stopped_one_after_the_other_stop_their_path() -> None:
    went = run(2, {STOPPED: [Hold(F0)], STOPPED + 20: [Hold(F1)], RESUMED: [Resume(F1)]})
    times = {record.tick: record.source_s for record in went.records}
    assert times[STOPPED + 20] > times[STOPPED], "the second one goes on without the first"
    assert times[STOPPED + 30] == times[RESUMED]
    assert times[RESUMED + 100] > times[RESUMED], "and does so again"


def test_of_robots_stopped_together_one_that_is_resumed_waits_for_the_other() -> None:
    went = run(2, {STOPPED: [Hold()], RESUMED: [Resume(F0)], RESUMED + 150: [Resume(F1)]})
    times = {record.tick: record.source_s for record in went.records}
    assert times[STOPPED + 1] == times[RESUMED + 150]
    assert times[RESUMED + 250] > times[RESUMED]


SILENT = "faults:\n  - {at_s: 1.25, for_s: 0.2, kind: silent, axis: f0.left}\n"


@pytest.mark.parametrize("goes_on", [F0, None])
def test_after_a_fault_it_goes_on_where_it_stopped(goes_on: tuple[str, ...] | None) -> None:
    loaded = load(1, options=SILENT)
    collector = Collector(loaded)
    # An order before makes the run wait although its only robot is in FAULT.
    orders: dict[int, list[Message]] = {
        100: [Hold()], 120: [Resume(None)], RESUMED - 100: [ClearFault()], RESUMED: [Resume(goes_on)],
    }  # fmt: skip
    path = circle(loaded, period_s=4.0)
    run_virtual(loaded, 200.0, path, sinks=[collector], orders=orders, ticks=1500)
    times = {record.tick: record.source_s for record in collector.records}
    assert times[270] == times[RESUMED] < path.end_s
    assert off_the_circle_m(collector, 0) < 2e-3, "the silent servo stopped beside its command"
    assert [event["event"] for event in collector.events if event["event"] == "end"] == ["end"]
