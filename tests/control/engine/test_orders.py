"""Orders of a person or a client while a run goes on, in virtual time."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from contid.control.engine.messages import (
    NOT_AT_START,
    Begin,
    ClearFault,
    Estop,
    Finish,
    Go,
    Goto,
    Hold,
    Mark,
    Message,
    Play,
    Resume,
    Rows,
    Stop,
)
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.supervisor import Mode
from contid.robot_file.base import StopPolicy
from contid.targets import Target
from tests.support.fingers import Collector, circle, load, run_virtual

HERE = Target(tip_m=(0.05, 0.075, 0.0))
THERE = Target(tip_m=(0.045, 0.08, 0.0))
SILENT = "faults:\n  - {at_s: 1.0, for_s: 0.2, kind: silent, axis: f0.left}\n"

OVERLOAD = "faults:\n  - {at_s: 3.5, for_s: 0.2, kind: overload, axis: f0.left}\n"


def run(
    orders: Mapping[int, Sequence[Message]], ticks: int, options: str = "", on_fault: str = "hold"
) -> Collector:
    loaded = load(1, options=options)
    collector = Collector(loaded)
    run_virtual(loaded, 200.0, None, sinks=[collector], orders=orders, ticks=ticks)
    return collector


def events_of(collector: Collector, kind: str) -> list[dict[str, object]]:
    return [event for event in collector.events if event["event"] == kind]


def test_the_end_of_a_goto_is_an_event_arrived_or_dropped() -> None:
    went = run(
        {50: [Goto("f0", HERE)], 600: [Goto("f0", THERE)], 620: [Hold()], 800: [Goto("f0", HERE)]}, 1400
    )
    assert [event["arrived"] for event in events_of(went, "goto")] == [True, False, True]


def test_a_goto_to_where_it_is_arrives_too() -> None:
    went = run({50: [Goto("f0", HERE)], 600: [Goto("f0", HERE)]}, 700)
    assert [event["arrived"] for event in events_of(went, "goto")] == [True, True]


def test_a_goto_replaces_the_one_before() -> None:
    went = run({50: [Goto("f0", HERE)], 53: [Goto("f0", THERE)]}, 700)
    assert [event["arrived"] for event in events_of(went, "goto")] == [False, True]


def test_a_played_trajectory_and_a_stream_end_without_ending_the_run() -> None:
    loaded = load(1)
    collector = Collector(loaded)
    orders: dict[int, list[Message]] = {
        50: [Play(circle(loaded, period_s=0.5)), Resume(("f0",))],
        700: [Begin(), Rows({"f0": THERE}), Resume(("f0",)), Mark(7)],
    }
    run_virtual(loaded, 200.0, None, sinks=[collector], orders=orders, ticks=1000)
    assert [event["event"] for event in collector.events if event["event"] in ("end", "stopping")] == ["end"]
    assert events_of(collector, "mark") == [{"event": "mark", "number": 7, "tick": 700}]
    assert collector.modes("f0")[-2:] == ["APPROACH", "RUN"]
    last = collector.records[-1].robots[0]
    assert last.tip_error_m == pytest.approx(0.0, abs=1e-6)


def test_a_trajectory_begins_where_it_begins_though_the_robot_was_on_its_way_elsewhere() -> None:
    loaded = load(1)
    collector = Collector(loaded)
    path = circle(loaded, period_s=0.8)
    orders: dict[int, list[Message]] = {
        50: [Goto("f0", Target(tip_m=(0.06, 0.06, 0.0)))],
        80: [Play(path), Resume(("f0",))],
    }
    run_virtual(loaded, 200.0, None, sinks=[collector], orders=orders, ticks=900)
    assert [event["arrived"] for event in events_of(collector, "goto")] == [False]
    began = next(record for record in collector.records if record.robots[0].mode == Mode.RUN)
    (target,) = path.targets_of_row(0).values()
    axes = [axis.command for axis in began.robots[0].axes]
    model = build_robot_configs(loaded, 200.0)[0].model
    assert math.dist(model.forward(tuple(axes)).tip_m, target.tip_m or ()) < 1e-3


def test_a_trajectory_that_waits_begins_in_the_tick_of_its_order() -> None:
    loaded = load(1)
    collector = Collector(loaded)
    path = circle(loaded, period_s=0.5)
    orders: dict[int, list[Message]] = {50: [Play(path, waits=True), Resume(("f0",))], 600: [Go(3.0, 3.001)]}
    run_virtual(loaded, 200.0, None, sinks=[collector], orders=orders, ticks=1400)
    times = {record.tick: record.source_s for record in collector.records}
    assert {times[tick] for tick in range(60, 601)} == {path.start_s}
    assert times[601] > path.start_s
    assert [event["tick"] for event in events_of(collector, "order") if event["order"] == "go"] == [600]
    assert [event["event"] for event in collector.events if event["event"] == "end"] == ["end"]


@pytest.mark.parametrize(
    "before",
    [
        [Resume(("f0",))],  # on its way there
        [],  # it has not been sent there
        [Resume(("f0",)), Hold(("f0",))],
    ],
)
def test_what_is_not_at_the_first_row_does_not_begin_and_holds(before: list[Message]) -> None:
    loaded = load(1)
    collector = Collector(loaded)
    path = circle(loaded, period_s=0.5)
    orders: dict[int, list[Message]] = {50: [Play(path, waits=True), *before], 55: [Go(3.0, 3.001)]}
    run_virtual(loaded, 200.0, None, sinks=[collector], orders=orders, ticks=500)
    assert NOT_AT_START in [event["message"] for event in events_of(collector, "refused")]
    assert [event["order"] for event in events_of(collector, "order")][-1] == "hold", "so it is replayed"
    assert collector.modes("f0")[-1] == "HOLD"
    assert {record.source_s for record in collector.records if record.tick > 60} == {path.start_s}


@pytest.mark.parametrize("order", [Stop(), Estop()])
def test_a_stopped_robot_in_fault_stays_there_until_it_is_cleared(order: Message) -> None:
    """Torque goes by the policy, the latch stays: resume is refused before clear-fault."""
    orders: dict[int, list[Message]] = {
        100: [Hold()], 300: [order], 320: [Resume(("f0",))],
        340: [ClearFault()], 360: [Resume(("f0",))],
    }  # fmt: skip
    went = run(orders, 500, SILENT)
    assert went.modes("f0")[-5:] == ["HOLD", "FAULT", "READY", "ARMING", "HOLD"]
    assert "cannot resume while FAULT" in str(events_of(went, "refused")[0]["message"])


@pytest.mark.parametrize(
    ("orders", "arrived"),
    [
        ([Goto("f0", HERE), Hold()], [False]),
        ([Goto("f0", HERE), Stop()], [False]),
        ([Goto("f0", HERE), Estop()], [False]),
        ([Goto("f0", HERE), Resume(("f0",))], [False]),
        ([Goto("f0", HERE), Goto("f0", THERE)], [False, True]),
        ([Goto("f0", HERE), Hold(), Goto("f0", THERE)], [False, True]),
        ([Goto("f0", HERE), Mark(7)], [True]),
    ],
)
def test_each_goto_ends_once_also_one_that_no_tick_has_seen(
    orders: list[Message], arrived: list[bool]
) -> None:
    """Orders of one tick: a client whose goto never ends waits for ever, and so do those after it."""
    went = run({50: [Hold()], 150: orders}, 500)
    assert [event["arrived"] for event in events_of(went, "goto")] == arrived


def test_an_order_that_fails_inside_is_that_robots_fault_and_the_run_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from contid.control.tick import transitions
    from contid.trajectory.approach import MotionError

    def none(*_: object, **__: object) -> None:
        raise MotionError("no motion from here")

    loaded = load(2)
    collector = Collector(loaded)
    orders: dict[int, list[Message]] = {
        50: [Goto("f0", HERE)],
        80: [Stop(("f0",), StopPolicy.REST)],
        200: [ClearFault(("f0",))],
        220: [Resume(("f0",))],
        300: [Finish(StopPolicy.REST)],
    }
    monkeypatch.setattr(transitions, "approach_after_stop", none)
    run_virtual(loaded, 200.0, None, sinks=[collector], orders=orders, ticks=600)
    assert collector.modes("f0")[-6:] == ["APPROACH", "FAULT", "READY", "ARMING", "HOLD", "FAULT"]
    assert all("no motion from here" in str(event["message"]) for event in events_of(collector, "fault"))
    assert events_of(collector, "fault")[0]["name"] == "INTERNAL"
    assert collector.modes("f1")[-2:] == ["HOLD", "FAULT"], "it cannot be brought to rest either"


@pytest.mark.parametrize("order", [Estop(), Stop(None, StopPolicy.VENT)])
def test_a_fault_in_the_tick_of_an_order_to_rest_does_not_take_its_place(
    order: Message, tmp_path: Path
) -> None:
    jump = "faults:\n  - {at_s: 0.5, axis: f0.left, kind: jump, by_deg: 12}\n"
    (found,) = events_of(run({}, 120, jump), "fault")
    path = tmp_path / "journal.jsonl"
    went = run({found["tick"]: [order]}, 130, f"journal_file: {path}\n{jump}")  # type: ignore[dict-item]
    assert went.modes("f0")[-1] == "FAULT", "both come in one tick"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert not any(axis["on"] for axis in lines[-1]["axes"].values())


@pytest.mark.slow
@pytest.mark.parametrize("step", [pytest.param(31, marks=pytest.mark.campaign), 60])
def test_estop_rests_the_devices_in_the_tick_it_comes_in_every_state(tmp_path: Path, step: int) -> None:
    """By the journal of the devices, at the deadline of that very tick every axis is off."""
    seen: set[int] = set()
    for at in (*range(9), *range(9, 740, step)):
        path = tmp_path / f"{at}.jsonl"
        loaded = load(1, options=f"journal_file: {path}\n{OVERLOAD}")
        collector = Collector(loaded)
        script: dict[int, list[Message]] = {
            30: [Play(circle(loaded, period_s=0.8)), Resume(("f0",))],
            300: [Hold()],
            340: [Goto("f0", THERE)],
            440: [Resume(("f0",))],
            460: [Stop(policy=StopPolicy.REST)],
            620: [Resume(("f0",))],
        }
        orders: dict[int, list[Message]] = {tick: sent for tick, sent in script.items() if tick < at}
        orders[at] = [Estop()]
        run_virtual(loaded, 200.0, None, sinks=[collector], orders=orders, ticks=at + 3)
        before = [record for record in collector.records if record.tick == at - 1]
        mode = before[0].robots[0].mode if before else int(Mode.CONNECTING)
        seen.add(mode)
        lines = [json.loads(line) for line in path.read_text().splitlines()]
        resting = [line for line in lines if line["event"] == "disable"]
        assert resting, f"tick {at} in {Mode(mode).name}"
        assert resting[-1]["t_s"] == pytest.approx(at / 200.0, abs=1e-9)
        assert not any(axis["on"] for axis in lines[-1]["axes"].values())
    assert seen >= set(Mode) - {Mode.READY}, "READY passes within a tick"


@pytest.mark.parametrize("who", [None, ("f0",)])
def test_a_hold_does_not_end_a_stop_and_is_refused_by_name_and_to_all(who: tuple[str, ...] | None) -> None:
    stop = Stop(None, StopPolicy.REST)
    ran = run({50: [Goto("f0", HERE)], 600: [stop], 610: [Mark(1), Hold(who), Mark(2)]}, 900)
    kinds = [event["event"] for event in ran.events if event["event"] in ("mark", "refused")]
    assert kinds == ["mark", "refused", "mark"]
    assert "cannot hold while STOPPING" in str(events_of(ran, "refused")[0]["message"])
    assert ran.modes("f0")[-2:] == ["STOPPING", "OFF"]
