"""Whole runs in virtual time: what the robots do, bit for bit, well and with every fault."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest

from contid.control.engine import messages as msg
from contid.control.engine.command_log import CommandLog
from contid.control.engine.cycle import OnEnd
from contid.control.engine.tick_layout import TickRecord
from contid.control.engine.virtual import VirtualProcess, run_virtual
from contid.control.engine.wiring import record_layout
from contid.control.tick.faults import Fault
from contid.control.tick.preflight.rows import Preflight
from contid.control.tick.supervisor import Mode
from contid.kinematics.model import Model
from contid.robot_file.base import StopPolicy
from contid.targets import Actuation, Solution, Target
from contid_clearance.watch import ClearanceWatch
from contid_contact.stage import ContactStage
from contid_ropes.monitor import ChainMonitor
from tests.support.fingers import Collector, circle, load

RATE = 200.0


@pytest.mark.parametrize("count", [1, 2, pytest.param(6, marks=pytest.mark.campaign)])
def test_the_same_input_gives_the_same_bytes(count: int, tmp_path: Path) -> None:
    logs = []
    for attempt in range(2):
        loaded = load(count)
        log = CommandLog(tmp_path / f"{attempt}.csv", record_layout(loaded, RATE))
        report = run_virtual(loaded, RATE, circle(loaded), sinks=[log])
        log.close()
        logs.append((tmp_path / f"{attempt}.csv").read_bytes())
        assert report.exit_code == 0
        assert len(logs[-1].splitlines()) == report.ticks + 1
    assert logs[0] == logs[1]


def test_it_follows_to_rounding_and_takes_the_way_of_states() -> None:
    loaded = load(2)
    seen = Collector(loaded)
    report = run_virtual(loaded, RATE, circle(loaded), sinks=[seen])
    for name in ("f0", "f1"):
        assert report.robots[name]["tip_error_max_mm"] < 1e-9
        assert report.robots[name]["ticks_limited"] == {}
        # READY is passed within the tick that saw the first samples.
        assert seen.modes(name) == ["CONNECTING", "ARMING", "APPROACH", "RUN", "STOPPING", "OFF"]


def axis_path(seen: Collector, robot: int = 0, axis: int = 0) -> list[float]:
    records = [r for r in seen.records if isinstance(r, TickRecord)]
    values = [r.robots[robot].axes[axis].command for r in records]
    return [v for v in values if not math.isnan(v)]


@pytest.mark.parametrize("interrupt_at", [None, 60, 260, pytest.param(300, marks=pytest.mark.campaign)])
def test_commands_never_jump(interrupt_at: int | None) -> None:
    """Velocity, acceleration and, over the whole run, no step that the limits do not allow."""
    loaded = load(1, on_interrupt="rest")
    seen = Collector(loaded)
    orders: dict[int, list[msg.Message]] = {} if interrupt_at is None else {interrupt_at: [msg.Finish()]}
    run_virtual(loaded, RATE, circle(loaded), sinks=[seen], orders=orders)
    path = axis_path(seen)
    steps = [b - a for a, b in pairwise(path)]
    assert max(map(abs, steps)) <= 0.100 / RATE * (1 + 1e-9)
    changes = [b - a for a, b in zip([0.0, *steps], [*steps, 0.0], strict=True)]
    assert max(map(abs, changes)) <= 1.0 / RATE**2 * (1 + 1e-6)
    if interrupt_at is not None and interrupt_at > 2:
        assert path[-1] == pytest.approx(0.060, abs=1e-12)


def test_the_first_command_is_where_the_robot_is() -> None:
    loaded = load(1)
    seen = Collector(loaded)
    run_virtual(loaded, RATE, circle(loaded), sinks=[seen])
    records = [r for r in seen.records if isinstance(r, TickRecord)]
    first = next(i for i, r in enumerate(records) if not math.isnan(r.robots[0].axes[0].device))
    commanded = records[first].robots[0].axes[0].device
    # One tick into a jerk-limited start: below the resolution of any servo.
    assert commanded == pytest.approx(records[first - 1].robots[0].axes[0].value, abs=2e-3)
    assert all(math.isnan(r.robots[0].axes[0].device) for r in records[:first])


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ("faults: [{at_s: 1.0, kind: silent, axis: f0.left}]", Fault.AXIS_SILENT),
        ("faults: [{at_s: 1.0, kind: stale, axis: f0.left}]", Fault.AXIS_STALE),
        ("faults: [{at_s: 1.0, kind: overload, axis: f0.left}]", Fault.DEVICE_FAULT),
    ],
)
def test_a_fault_of_one_robot_leaves_the_other_alone(options: str, fault: Fault) -> None:
    loaded = load(2, options=options)
    seen = Collector(loaded)
    report = run_virtual(loaded, RATE, circle(loaded), sinks=[seen])
    assert report.exit_code == 3
    assert report.robots["f0"]["fault"] == fault
    assert "f0.left" in report.robots["f0"]["message"]
    assert report.robots["f1"]["fault"] == 0
    assert seen.modes("f1")[-3:] == ["RUN", "STOPPING", "OFF"]
    assert report.robots["f1"]["tip_error_max_mm"] < 1e-9


def test_misses_within_the_tolerance_are_no_fault() -> None:
    loaded = load(1, tolerance=5, options="faults: [{at_s: 1.0, kind: silent, axis: f0.left, for_s: 0.015}]")
    assert run_virtual(loaded, RATE, circle(loaded)).exit_code == 0


def test_a_lost_bus_stops_its_robots_only_and_comes_back_without_moving() -> None:
    loaded = load(2, buses=2, options="faults: [{at_s: 1.0, kind: lost, for_s: 0.5}]")
    seen = Collector(loaded)
    orders: dict[int, list[msg.Message]] = {
        500: [msg.ClearFault(("f0",))],
        520: [msg.Resume(("f0",))],
    }
    report = run_virtual(loaded, RATE, circle(loaded, period_s=4.0), sinks=[seen], orders=orders)
    modes = seen.modes("f0")
    assert modes[modes.index("FAULT") :] == [
        "FAULT", "READY", "ARMING", "APPROACH", "RUN", "STOPPING", "OFF",
    ]  # fmt: skip
    assert "FAULT" not in seen.modes("f1")
    records = [r for r in seen.records if isinstance(r, TickRecord)]
    # Nothing is commanded between the loss and the order to go on.
    lost = next(r.tick for r in records if r.robots[0].mode == Mode.FAULT)
    assert all(math.isnan(r.robots[0].axes[0].device) for r in records if lost < r.tick <= 520)
    assert report.exit_code == 0


def test_clear_fault_refuses_while_something_is_wrong() -> None:
    loaded = load(2, options="faults: [{at_s: 1.0, kind: silent, axis: f0.left}]")
    seen = Collector(loaded)
    orders: dict[int, list[msg.Message]] = {300: [msg.ClearFault(("f0",))]}
    run_virtual(loaded, RATE, circle(loaded, period_s=3.0), sinks=[seen], orders=orders)
    assert [e["robot"] for e in seen.events if e["event"] == "refused"] == ["f0"]
    assert seen.modes("f0")[-1] == "FAULT"


@pytest.mark.parametrize(("policy", "rest"), [("relax", True), ("hold", False)])
def test_on_fault_is_a_policy(policy: str, rest: bool) -> None:
    loaded = load(1, on_fault=policy, options="faults: [{at_s: 1.4, kind: silent, axis: f0.left}]")
    seen = Collector(loaded)
    run_virtual(loaded, RATE, circle(loaded, period_s=3.0), sinks=[seen])
    records = [r for r in seen.records if isinstance(r, TickRecord)]
    first = next(i for i, r in enumerate(records) if r.robots[0].mode == Mode.FAULT)
    assert math.isnan(records[first].robots[0].axes[0].device) == rest


def test_hold_pauses_the_trajectory_and_resume_goes_on() -> None:
    loaded = load(2)
    seen = Collector(loaded)
    orders: dict[int, list[msg.Message]] = {300: [msg.Hold()], 500: [msg.Resume()]}
    report = run_virtual(loaded, RATE, circle(loaded, period_s=2.0), sinks=[seen], orders=orders)
    assert report.exit_code == 0
    for name in ("f0", "f1"):
        modes = seen.modes(name)
        assert modes[modes.index("HOLD") - 1 :] == ["RUN", "HOLD", "APPROACH", "RUN", "STOPPING", "OFF"]
        assert report.robots[name]["tip_error_max_mm"] < 1e-9
    records = [r for r in seen.records if isinstance(r, TickRecord)]
    times = [r.source_s for r in records if not math.isnan(r.source_s)]
    assert times == sorted(times)
    assert times[-1] == 2.0


def test_goto_then_hold() -> None:
    loaded = load(1)
    seen = Collector(loaded)
    target = Target(tip_m=(0.040, 0.080, 0.0))
    orders: dict[int, list[msg.Message]] = {10: [msg.Goto("f0", target)]}
    run_virtual(loaded, RATE, None, sinks=[seen], orders=orders, ticks=600)
    assert seen.modes("f0")[-2:] == ["APPROACH", "HOLD"]
    plan_tip = [r for r in seen.records if isinstance(r, TickRecord)][-1].robots[0]
    assert plan_tip.mode == Mode.HOLD


def test_orders_that_do_not_fit_are_refused_with_a_message() -> None:
    loaded = load(1)
    seen = Collector(loaded)
    orders: dict[int, list[msg.Message]] = {0: [msg.ClearFault(("f0",)), msg.Hold(("thumb",))]}
    run_virtual(loaded, RATE, None, sinks=[seen], orders=orders, ticks=5)
    message = [str(e["message"]) for e in seen.events if e["event"] == "refused"]
    assert "cannot clear-fault while CONNECTING" in message[0]
    assert "no robot 'thumb'; there are f0" in message[1]


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_fault_at_speed_stops_within_the_limits_before_the_run_ends(interrupted: bool) -> None:
    """The end of the run, also an orderly stop asked for in between, waits for the standstill."""
    loaded = load(1, options="faults:\n  - {at_s: 1.5, kind: overload, axis: f0.left}\n")
    seen = Collector(loaded)
    orders: dict[int, list[msg.Message]] = {302: [msg.Finish()]} if interrupted else {}
    assert run_virtual(loaded, RATE, circle(loaded), sinks=[seen], orders=orders).exit_code == 3
    steps = [b - a for a, b in pairwise(axis_path(seen))]
    changes = [b - a for a, b in zip([0.0, *steps], [*steps, 0.0], strict=True)]
    assert max(map(abs, changes)) <= 1.0 / RATE**2 * (1 + 1e-6)
    jerks = [b - a for a, b in pairwise(changes)][-20:]
    assert max(map(abs, jerks)) <= 20.0 / RATE**3 * 1.01
    assert max(map(abs, steps[-20:])) > 1e-5
    assert seen.modes("f0")[-1] == "FAULT"


@pytest.mark.parametrize("on_end", list(OnEnd))
def test_the_end_is_a_choice(on_end: OnEnd) -> None:
    loaded = load(1)
    seen = Collector(loaded)
    report = run_virtual(loaded, RATE, circle(loaded), sinks=[seen], on_end=on_end)
    assert report.exit_code == 0
    assert seen.modes("f0")[-1] == ("RUN" if on_end is OnEnd.HOLD else "OFF")
    if on_end is OnEnd.REST:
        assert axis_path(seen)[-1] == pytest.approx(0.060, abs=1e-12)


def test_estop_at_once_from_motion() -> None:
    loaded = load(2)
    seen = Collector(loaded)
    run_virtual(loaded, RATE, circle(loaded), sinks=[seen], orders={300: [msg.Estop(), msg.Finish()]})
    ticks = [e["tick"] for e in seen.events if e["event"] == "state" and e["mode"] == "OFF"]
    assert ticks == [300, 300]


def test_a_stream_holds_on_a_bad_row_and_goes_on() -> None:
    loaded = load(1)
    seen = Collector(loaded)
    good, other = Target(tip_m=(0.050, 0.075, 0.0)), Target(tip_m=(0.052, 0.075, 0.0))
    rows = [{"f0": good}] * 400 + [{"f0": None}] * 50 + [{"f0": other}] * 200
    report = run_virtual(loaded, RATE, None, sinks=[seen], rows=rows)
    modes = seen.modes("f0")
    assert modes[modes.index("RUN") :] == ["RUN", "HOLD", "APPROACH", "RUN", "STOPPING", "OFF"]
    assert report.exit_code == 0


def test_every_robot_in_fault_ends_the_run() -> None:
    loaded = load(1, options="faults: [{at_s: 0.5, kind: silent, axis: f0.left}]")
    report = run_virtual(loaded, RATE, circle(loaded, period_s=100.0))
    assert report.exit_code == 3
    assert report.ticks < 1000


def test_stop_policies_override() -> None:
    loaded = load(1)
    seen = Collector(loaded)
    orders: dict[int, list[msg.Message]] = {300: [msg.Stop(("f0",), StopPolicy.RELAX)], 400: [msg.Finish()]}
    run_virtual(loaded, RATE, circle(loaded), sinks=[seen], orders=orders)
    assert seen.modes("f0")[-2:] == ["STOPPING", "OFF"]


def test_nothing_that_moves_is_obeyed_while_a_run_ends() -> None:
    """One robot rests at once, the other takes its time: resume in between must not arm the first again."""
    loaded = load(2, on_interrupt="rest")
    seen = Collector(loaded)
    orders: dict[int, list[msg.Message]] = {200: [msg.Stop(("f0",), StopPolicy.HOLD)], 260: [msg.Finish()]}
    orders |= {tick: [msg.Resume()] for tick in range(261, 2000, 5)}
    report = run_virtual(loaded, RATE, circle(loaded), sinks=[seen], orders=orders, ticks=2000)
    assert report.ticks < 1000
    assert seen.modes("f0")[-1] == "OFF"
    assert seen.modes("f1")[-2:] == ["STOPPING", "OFF"]
    assert any(event["event"] == "refused" for event in seen.events)


def test_a_live_row_is_solved_once_by_its_check_and_once_in_each_tick(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Decision 0023: nothing solves it a third time."""
    process = VirtualProcess(load(2), RATE, Collector(), attended=True)
    robots = process.engine.robots
    check = Preflight(robots.configs)
    solved: list[Target] = []
    kind = type(robots.configs[0].model)
    inverse = kind.inverse

    def counted(self: Model, target: Target, seed: Actuation) -> Solution:
        solved.append(target)
        return inverse(self, target, seed)

    monkeypatch.setattr(kind, "inverse", counted)
    row = {"f0": Target(tip_m=(0.055, 0.075, 0.0)), "f1": Target(tip_m=(0.045, 0.075, 0.0))}
    assert not check.row(row)
    assert len(solved) == 2
    process.engine.arm()
    process.engine.obey(msg.Rows(row), 0)
    for _ in range(400):
        solved.clear()
        process.begin()
        process.turn()
    process.close()
    assert all(state.mode is Mode.RUN for state in robots.states)
    assert len(solved) == 2


def test_a_file_without_chains_clearance_and_contacts_makes_no_call_of_them_in_a_tick(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def called(*_: object) -> None:
        raise AssertionError("called")

    for kind in (ChainMonitor, ClearanceWatch, ContactStage):
        for method in {"before", "after", "settle"} & vars(kind).keys():
            monkeypatch.setattr(kind, method, called)
    loaded = load(2)
    assert run_virtual(loaded, RATE, circle(loaded)).exit_code == 0
