"""Motions of chains: the arms of a chain move together or not at all, and never where the rope forbids it."""

from __future__ import annotations

import io
import math
from itertools import pairwise

import pytest

from contid.control.engine import messages as msg
from contid.control.engine.cycle import OnEnd
from contid.control.engine.tick_layout import ENABLED, TickRecord
from contid.control.engine.virtual import run_virtual
from contid.control.engine.wiring import build_preflight
from contid.control.tick.faults import Fault
from contid.control.tick.preflight.rows import Unreachable
from contid.control.tick.supervisor import Mode
from contid.errors import BadInputError
from contid.kinematics.model import build_model
from contid.robot_file.base import StopPolicy
from contid.robot_file.load import LoadedFile, parse_robot_file
from contid.targets import Target, Vec3
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory
from contid_ropes.monitor import ChainMonitor
from tests.support.fingers import Collector

RATE = 100.0
LOW, HIGH = (0.0, 0.0, 0.19), (0.0, 0.0, 0.28)


def chain(
    *,
    length_mm: float = 1000,
    floor_mm: float = -300,
    on_interrupt: str = "hold",
    on_fault: str = "hold",
    right_bus: str = "",
    rest_mm: float = 115,
    left_start_mm: float = 115,
) -> LoadedFile:
    """Two upright arms 700 mm apart on servos, each on a bus of its own, and a rope."""
    lines = [
        "contid: 1",
        "name: chain",
        "rate_hz: 100",
        "buses:",
        "  a: {driver: sim}",
        "  b:",
        "    driver: sim",
    ]
    lines += [f"    {line}" for line in right_bus.splitlines()]
    lines.append("robots:")
    for name, x, bus in (("left", 0, "a"), ("right", 700, "b")):
        lines += [
            f"  {name}:",
            "    model: tri_tube",
            f"    base: {{x_mm: {x}}}",
            "    geometry: {radius_mm: [40, 32]}",
            "    limits: {length_mm: [[80, 150], [80, 150]]}",
            "    rates: {velocity_mm_s: 100, acceleration_mm_s2: 1000, jerk_mm_s3: 20000}",
            f"    rest_mm: [{', '.join(6 * [str(rest_mm)])}]",
            f"    stop: {{on_interrupt: {on_interrupt}, on_fault: {on_fault}, on_host_loss: relax}}",
            "    axes:",
        ]
        start_deg = (left_start_mm if name == "left" else 115) / 37.7 * 360
        lines += [
            f"      s{s}.l{j}: {{bus: {bus}, device: servo, velocity_deg_s: 1200, mm_per_rev: 37.7, "
            f"start_deg: {start_deg}}}"
            for s in (1, 2)
            for j in (1, 2, 3)
        ]
    lines += [
        "  rope:",
        "    model: chain",
        f"    links: [{{arm: left}}, {{rope: {{length_mm: {length_mm}}}}}, {{arm: right}}]",
        f"    floor_mm: {floor_mm}",
    ]
    return parse_robot_file("\n".join(lines) + "\n", "chain.yaml")


def rows(loaded: LoadedFile, *tips_mm: tuple[float, ...], period_s: float = 1.0) -> Trajectory:
    """Rows of (left x, y, z, right x, y, z), the bases left at the tips' own places."""
    names = [f"{arm}.{axis}_mm" for arm in ("left", "right") for axis in "xyz"]
    lines = [",".join(["t_s", *names])]
    lines += [",".join(map(repr, (k * period_s, *tips))) for k, tips in enumerate(tips_mm)]
    return read_trajectory(io.StringIO("\n".join(lines) + "\n"), "t.csv", loaded.driven)


UP = (0.0, 0.0, 250.0, 700.0, 0.0, 250.0)


def tips(loaded: LoadedFile, seen: Collector) -> dict[str, list[Vec3]]:
    """Tips of both arms in the world at every tick with a command."""
    found: dict[str, list[Vec3]] = {"left": [], "right": []}
    for index, (name, x) in enumerate((("left", 0.0), ("right", 0.7))):
        model = build_model(loaded.file.robots[name])
        for record in seen.records:
            assert isinstance(record, TickRecord)
            command = tuple(axis.command for axis in record.robots[index].axes)
            if not any(map(math.isnan, command)):
                tip = model.forward(command).tip_m
                found[name].append((tip[0] + x, tip[1], tip[2]))
    return found


def moved_m(loaded: LoadedFile, seen: Collector, robot: str) -> float:
    path = tips(loaded, seen)[robot]
    return max((math.dist(path[0], tip) for tip in path), default=0.0)


def spans(loaded: LoadedFile, seen: Collector) -> list[float]:
    """Distance of the tips, from the tick on at which both are commanded."""
    both = tips(loaded, seen)
    count = min(map(len, both.values()))
    return [math.dist(a, b) for a, b in zip(both["left"][-count:], both["right"][-count:], strict=True)]


def message(seen: Collector, kind: str) -> list[str]:
    return [str(event["message"]) for event in seen.events if event["event"] == kind]


def hold_at(loaded: LoadedFile, orders: dict[int, list[msg.Message]], ticks: int = 600) -> Collector:
    """A run that stands on its only row, where orders reach it."""
    seen = Collector(loaded)
    run_virtual(
        loaded,
        RATE,
        rows(loaded, UP, UP, period_s=8.0),
        sinks=[seen],
        orders=orders,
        ticks=ticks,
    )
    return seen


def test_the_arms_begin_their_approach_in_the_same_tick() -> None:
    """Though the right one is armed ten ticks later."""
    loaded = chain()
    seen = Collector(loaded)
    late: dict[int, list[msg.Message]] = {0: [msg.Stop(("right",))], 10: [msg.Resume(("right",))]}
    report = run_virtual(loaded, RATE, rows(loaded, UP, UP), sinks=[seen], orders=late)
    assert report.exit_code == 0
    begun = [e["tick"] for e in seen.events if e["event"] == "state" and e["mode"] == "APPROACH"]
    assert len(begun) == 2
    assert begun[0] == begun[1]
    assert seen.modes("left")[:4] == ["CONNECTING", "ARMING", "HOLD", "APPROACH"]


def test_an_approach_the_rope_forbids_does_not_begin() -> None:
    """Armed 230 mm high; the first row lays the rope on the ground. Nothing moves."""
    loaded = chain(floor_mm=-120)
    seen = Collector(loaded)
    low = (0.0, 0.0, 190.0, 700.0, 0.0, 190.0)
    report = run_virtual(loaded, RATE, rows(loaded, low, low), sinks=[seen])
    assert report.exit_code == 3
    found = message(seen, "fault")
    assert len(found) == 2
    assert all("fault 301 chain-forbids: rope: on the way, the rope hangs" in each for each in found)
    assert moved_m(loaded, seen, "left") == moved_m(loaded, seen, "right") == 0.0


def test_a_rope_on_the_ground_may_be_lifted() -> None:
    """Arms that begin outside may move where it gets no worse, and not outside again."""
    loaded = chain(floor_mm=-80)
    seen = Collector(loaded)
    report = run_virtual(loaded, RATE, rows(loaded, UP, UP), sinks=[seen])
    assert report.exit_code == 0, report
    assert not message(seen, "fault")


def test_an_order_to_a_point_that_the_rope_forbids_is_refused() -> None:
    loaded = chain(floor_mm=-120)
    low = {"left": Target(tip_m=LOW), "right": Target(tip_m=(0.7, 0.0, 0.19))}
    seen = hold_at(
        loaded, {100: [msg.Goto(name, low[name]) for name in ("left", "right")], 101: [msg.Mark(1)]}
    )
    assert len(message(seen, "refused")) == 2
    assert all("rope: on the way, the rope hangs" in each for each in message(seen, "refused"))
    assert moved_m(loaded, seen, "left") < 0.03  # from arming to the row; not down


def both(tip_m: Vec3) -> list[msg.Message]:
    """Gotos of both arms to a tip above their bases."""
    x, y, z = tip_m
    return [msg.Goto("left", Target(tip_m=tip_m)), msg.Goto("right", Target(tip_m=(x + 0.7, y, z)))]


@pytest.mark.parametrize(
    ("ordered", "found"),
    [
        (both(LOW), "rope: on the way, the rope hangs"),
        ([msg.Stop(None, StopPolicy.REST)], "it stops where it is instead of at its rest pose"),
    ],
    ids=["goto", "rest"],
)
def test_a_way_that_the_rope_forbids_does_not_begin_from_motion_either(
    ordered: list[msg.Message], found: str
) -> None:
    """Arms in motion stop first; what follows is checked with it, in the tick of the order."""
    loaded = chain(floor_mm=-120, rest_mm=95)
    seen = hold_at(loaded, {100: both(HIGH), 108: ordered, 109: [msg.Mark(1)]})
    before = [tip[2] for tip in tips(loaded, seen)["left"]]
    assert max(before) > 0.251, "they were in motion"
    assert len(message(seen, "refused")) == 2
    assert all(found in each for each in message(seen, "refused"))
    assert min(before) > 0.22


def test_two_arms_ordered_at_once_are_checked_together() -> None:
    """One alone would pull the rope taut; both to the same side do not."""
    loaded = chain(length_mm=705)
    aside = {"left": (-0.05, 0.0, 0.24), "right": (0.65, 0.0, 0.24)}
    alone = hold_at(loaded, {100: [msg.Goto("left", Target(tip_m=aside["left"])), msg.Mark(1)]})
    (refused,) = message(alone, "refused")
    assert "mm too short between left and right" in refused
    both = hold_at(loaded, {100: [msg.Goto(name, Target(tip_m=tip)) for name, tip in aside.items()]})
    assert not message(both, "refused")
    assert max(spans(loaded, both)) <= 0.705
    arrived = [event["arrived"] for event in both.events if event["event"] == "goto"]
    assert arrived == [True, True]


@pytest.mark.parametrize("order", [msg.Hold, pytest.param(msg.Stop, marks=pytest.mark.campaign), msg.Estop])
def test_an_order_that_stops_one_arm_holds_the_other(order: type) -> None:
    loaded = chain()
    seen = Collector(loaded)
    back = (40.0, 0.0, 250.0, 740.0, 0.0, 250.0)
    run_virtual(
        loaded, RATE, rows(loaded, UP, back, UP, back), sinks=[seen],
        orders={120: [order(("left",))]}, ticks=300,
    )  # fmt: skip
    assert seen.modes("right")[-1] == "HOLD"
    before, after = (tips(loaded, seen)["right"][k] for k in (-50, -1))
    assert before == after


@pytest.mark.parametrize("ending", [msg.Estop(), msg.Finish(StopPolicy.REST)], ids=["estop", "finish"])
def test_a_check_that_fails_does_not_take_the_place_of_an_order_to_stop(
    monkeypatch: pytest.MonkeyPatch, ending: msg.Message
) -> None:
    """Gotos of the same tick are checked before the order, and the way to rest behind it."""

    def broken(*_: object) -> str:
        raise ZeroDivisionError("a defect of the rope")

    monkeypatch.setattr(ChainMonitor, "_forbids", broken)
    loaded = chain()
    seen = Collector(loaded)
    orders: dict[int, list[msg.Message]] = {100: [msg.Goto("left", Target(tip_m=HIGH)), ending, msg.Mark(1)]}
    run_virtual(loaded, RATE, None, sinks=[seen], orders=orders, ticks=110)
    assert not any(robot.flags & ENABLED for robot in seen.records[-1].robots)
    assert seen.modes("left")[-1] == seen.modes("right")[-1] == "OFF"
    assert message(seen, "refused")[0] == "rope: not checked, ZeroDivisionError: a defect of the rope"


def test_a_run_ends_though_the_check_of_the_way_to_rest_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    forbids = ChainMonitor._forbids

    def broken(self: ChainMonitor, *given: object) -> str:
        if any(state.mode is Mode.STOPPING for state in self._robots.states):
            raise ZeroDivisionError("a defect of the rope")
        return forbids(self, *given)  # type: ignore[arg-type]

    monkeypatch.setattr(ChainMonitor, "_forbids", broken)
    loaded = chain()
    report = run_virtual(loaded, RATE, rows(loaded, UP, UP), on_end=OnEnd.REST, ticks=900)
    assert [robot["mode"] for robot in report.robots.values()] == ["OFF", "OFF"]


def test_resumed_alone_an_arm_waits_for_the_other() -> None:
    loaded = chain()
    seen = Collector(loaded)
    orders: dict[int, list[msg.Message]] = {
        120: [msg.Hold(("left",))],
        160: [msg.Resume(("left",))],
        200: [msg.Resume(("right",))],
    }
    run_virtual(loaded, RATE, rows(loaded, UP, UP, period_s=9.0), sinks=[seen], orders=orders, ticks=260)
    states = [
        (e["tick"], e["robot"], e["mode"]) for e in seen.events if e["event"] == "state" and e["tick"] > 110
    ]
    assert [entry for entry in states if 120 < entry[0] < 200 and entry[2] != "HOLD"] == []
    # Both stand where they were: their approach has no length.
    assert {entry[1:] for entry in states if entry[0] == 200} == {("left", "RUN"), ("right", "RUN")}


@pytest.mark.parametrize(("kind", "policy"), [("overload", "hold"), ("lost", "relax")])
def test_a_fault_of_one_arm_stops_the_other(kind: str, policy: str) -> None:
    axis = ", axis: right.s1.l1" if kind == "overload" else ""
    loaded = chain(on_fault=policy, right_bus=f"faults: [{{at_s: 1.5, kind: {kind}{axis}}}]")
    seen = Collector(loaded)
    back = (40.0, 0.0, 250.0, 740.0, 0.0, 250.0)
    report = run_virtual(loaded, RATE, rows(loaded, UP, back, UP, back), sinks=[seen])
    assert report.exit_code == 3
    numbers = {e["robot"]: e["fault"] for e in seen.events if e["event"] == "fault"}
    assert numbers["left"] == Fault.CHAIN_BROKEN
    assert numbers["right"] in (Fault.DEVICE_FAULT, Fault.DEVICE_LOST)
    (found,) = (text for text in message(seen, "fault") if "302" in text)
    assert "rope: right has fault 10" in found
    ticks = [e["tick"] for e in seen.events if e["event"] == "fault"]
    assert ticks[0] == ticks[1]


def test_an_arm_stopped_by_a_fault_of_the_other_slows_down_from_the_next_command_on() -> None:
    """Its command of this tick is given when the fault of the other is noticed: the stop begins there."""
    loaded = chain(right_bus="faults: [{at_s: 1.5, kind: overload, axis: right.s1.l1}]")
    seen = Collector(loaded)
    back = (40.0, 0.0, 250.0, 740.0, 0.0, 250.0)
    run_virtual(loaded, RATE, rows(loaded, UP, back, UP, back), sinks=[seen])
    path = [record.robots[0] for record in seen.records if isinstance(record, TickRecord)]
    at = next(k for k, robot in enumerate(path) if robot.fault)
    commands = [robot.axes[0].command for robot in path[at - 2 : at + 5]]
    steps = [after - before for before, after in pairwise(commands)]
    sizes = [abs(step) for step in steps[1:]]
    assert sizes[0] > 1e-5
    # Its acceleration is taken back first, which one more step goes by.
    assert sizes[1:] == sorted(sizes[1:], reverse=True)


def test_cleared_alone_an_arm_does_not_follow_without_the_other() -> None:
    loaded = chain(right_bus="faults: [{at_s: 1.2, kind: overload, axis: right.s1.l1}]")
    seen = Collector(loaded)
    back = (40.0, 0.0, 250.0, 740.0, 0.0, 250.0)
    orders: dict[int, list[msg.Message]] = {
        10: [msg.Mark(1)],
        150: [msg.ClearFault(("left",))],
        160: [msg.Resume(("left",))],
    }
    run_virtual(
        loaded, RATE, rows(loaded, UP, back, UP, back, period_s=2.0), sinks=[seen], orders=orders, ticks=300
    )
    assert seen.modes("left")[-3:] == ["READY", "ARMING", "HOLD"]


@pytest.mark.slow
def test_a_rope_is_checked_between_rows_that_are_days_apart() -> None:
    """At once, and all the same where a curve between two good rows brings the tips too far apart."""
    loaded = chain(length_mm=720)
    preflight = build_preflight(loaded, RATE, Unreachable.REFUSE)
    assert preflight is not None
    preflight.trajectory(rows(loaded, UP, UP, period_s=100.0), "t.csv")
    left_mm = (0.0, -19.9, -19.0, 60.0)  # the curve swings out beyond 20 mm, where the rope is too short
    far = rows(loaded, *((x, 0.0, 250.0, 700.0, 0.0, 250.0) for x in left_mm), period_s=1e6)
    with pytest.raises(BadInputError, match="on the way to this row, rope"):
        preflight.trajectory(far, "t.csv")


def test_a_recovery_that_the_rope_forbids_is_over() -> None:
    """Afterwards the arm arms again by itself, and is outside its limits as before."""
    orders: dict[int, list[msg.Message]] = {
        1: [msg.Mark(1)],
        50: [msg.ClearFault(("right",))],
        60: [msg.Recover(("left",))],
        120: [msg.ClearFault(("left",))],
        130: [msg.Resume(("left",))],
    }
    # The rope hangs above its floor only while the left arm is 9 mm too long in each section.
    loaded = chain(left_start_mm=159, floor_mm=-52)
    seen = Collector(loaded)
    run_virtual(loaded, RATE, rows(loaded, UP, UP), sinks=[seen], orders=orders, ticks=200)
    faults = [e["fault"] for e in seen.events if e["event"] == "fault" and e["robot"] == "left"]
    assert faults == [Fault.OUTSIDE_LIMITS, Fault.CHAIN_FORBIDS, Fault.OUTSIDE_LIMITS]
    assert not any("on its way inside" in each for each in message(seen, "refused"))


@pytest.mark.parametrize("ending", ["finish", "stop", "on_end"])
def test_a_motion_to_the_rest_pose_that_the_rope_forbids_stops_in_place(ending: str) -> None:
    loaded = chain(floor_mm=-110, rest_mm=95)
    # Simulated servos begin in the middle of their travel, 230 mm high; the rest pose lies on the ground.
    seen = Collector(loaded)
    by_ending: dict[str, dict[int, list[msg.Message]]] = {
        "finish": {100: [msg.Finish(StopPolicy.REST)]},
        "stop": {100: [msg.Stop(None, StopPolicy.REST)]},
        "on_end": {},
    }
    orders = by_ending[ending]
    on_end = OnEnd.REST if ending == "on_end" else OnEnd.STOP
    run_virtual(loaded, RATE, rows(loaded, UP, UP), sinks=[seen], orders=orders, on_end=on_end, ticks=400)
    found = message(seen, "refused")
    assert len(found) == 2
    assert all("it stops where it is instead of at its rest pose" in each for each in found)
    assert tips(loaded, seen)["left"][-1][2] == pytest.approx(0.25, abs=1e-4)
    assert seen.modes("left")[-1] == "OFF"


def test_a_motion_to_the_rest_pose_that_the_rope_allows_is_completed() -> None:
    loaded = chain(floor_mm=-160, rest_mm=95)
    seen = Collector(loaded)
    run_virtual(loaded, RATE, rows(loaded, UP, UP), sinks=[seen], on_end=OnEnd.REST)
    assert not message(seen, "refused")
    assert tips(loaded, seen)["left"][-1][2] == pytest.approx(0.19, abs=1e-4)
