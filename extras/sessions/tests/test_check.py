"""The check of sessions: nothing in good runs, every rule in changed ones."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from contid.control.engine import messages as msg
from contid.control.engine.cycle import OnEnd
from contid.control.engine.events.robots import FaultLatched, ModeChanged, OrderGiven
from contid.control.engine.tick_layout import SKIPPED, TICK
from contid.control.process.pipe import RunSetup
from contid.control.tick.supervisor import Mode
from contid.errors import SessionError
from contid.robot_file.load import load_robot_file, parse_robot_file, with_mock
from contid.session.format.entries import Entry
from contid.session.read import Session
from contid.session.recording_observer import RecordingObserver
from contid.targets import Target
from contid_sessions.check import check_session
from contid_sessions.check_command import MAX_VIOLATIONS, command
from tests.campaign.script import close_hand
from tests.session.runs import RUNS, record_virtual
from tests.support.command import contid
from tests.support.fingers import circle, fingers, load, run_virtual

pytestmark = pytest.mark.process

HERE, THERE = Target(tip_m=(0.05, 0.075, 0.0)), Target(tip_m=(0.045, 0.08, 0.0))
GOLDEN = sorted((Path(__file__).parents[3] / "tests" / "golden").glob("*.mcap"))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One finger: a move, a stop on its way, an emergency stop, another start, a trajectory."""
    loaded = load(1)
    orders: dict[int, list[msg.Message]] = {
        50: [msg.Goto("f0", HERE)],
        300: [msg.Goto("f0", THERE)],
        320: [msg.Hold()],
        400: [msg.Goto("f0", HERE)],
        410: [msg.Estop()],
        500: [msg.Resume()],
        700: [msg.Goto("f0", THERE)],
        900: [msg.Play(circle(loaded))],
        901: [msg.Resume()],
    }
    path = tmp_path_factory.mktemp("check") / "run.mcap"
    return record_virtual(path, loaded, None, orders, ticks=1400)


def rules(session: Session) -> set[str]:
    return {violation.rule for violation in check_session(session)}


@pytest.mark.parametrize("path", GOLDEN, ids=[path.stem for path in GOLDEN])
def test_golden_sessions_break_no_rule(path: Path) -> None:
    assert not rules(Session(path))


@pytest.mark.parametrize("name", RUNS)
def test_runs_with_trackers_loads_and_faults_break_no_rule(name: str, tmp_path: Path) -> None:
    assert not rules(Session(RUNS[name](tmp_path / "run.mcap")))


def test_orders_stops_and_new_starts_break_no_rule(run: Path) -> None:
    assert list(check_session(Session(run))) == []


def test_the_shortest_stop_breaks_no_rule(tmp_path: Path) -> None:
    """A row leads one finger into the other: it stops in the shortest way, which is not limited in jerk."""

    def tips(left_x_m: float) -> msg.Rows:
        left, right = Target(tip_m=(left_x_m, 0.07, 0.0)), Target(tip_m=(0.045, 0.07, 0.0))
        return msg.Rows({"left": left, "right": right})

    orders: dict[int, list[msg.Message]] = {
        40: [msg.Begin(), msg.Resume()],
        300: [tips(0.02)],
        500: [tips(0.06)],
    }
    path = record_virtual(tmp_path / "run.mcap", with_mock(close_hand()), None, orders, ticks=1000)
    session = Session(path)
    assert list(check_session(session)) == []
    held = [each.tick for each in session.events() if isinstance(each, ModeChanged) and each.mode == "HOLD"]
    assert held[-1] > 500


class Changed(Session):
    """A session whose entries pass through a function; None drops one."""

    def __init__(self, path: Path, change: Callable[[Session, Entry], Entry | None]) -> None:
        super().__init__(path)
        self._change = change

    def entries(self) -> Iterator[Entry]:
        for entry in super().entries():
            changed = self._change(self, entry)
            if changed is not None:
                yield changed


def add(tick: int, name: str, value: float) -> Callable[[Session, Entry], Entry]:
    """Adds to a value of the first axis from a tick on."""

    def change(session: Session, entry: Entry) -> Entry:
        if entry.values is None or entry.values[TICK] < tick:
            return entry
        values = list(entry.values)
        values[session.layout.axis_place(0, 0, name)] += value
        return replace(entry, values=values)

    return change


def once(tick: int, change: Callable[[Session, list[float]], None]) -> Callable[[Session, Entry], Entry]:
    """Changes the record of one tick."""

    def changed(session: Session, entry: Entry) -> Entry:
        if entry.values is None or entry.values[TICK] != tick:
            return entry
        values = list(entry.values)
        change(session, values)
        return replace(entry, values=values)

    return changed


def mode(number: Mode) -> Callable[[Session, list[float]], None]:
    def change(session: Session, values: list[float]) -> None:
        values[session.layout.robot_place(0, "mode")] = number

    return change


def skip(session: Session, values: list[float]) -> None:
    values[SKIPPED] += 1


def without(kind: type) -> Callable[[Session, Entry], Entry | None]:
    return lambda _, entry: None if isinstance(entry.event, kind) else entry


def frozen(session: Session, entry: Entry) -> Entry:
    """What the left axis measured at first is measured for ever."""
    if entry.values is None or entry.values[TICK] < 250:
        return entry
    values = list(entry.values)
    values[session.layout.axis_place(0, 0, "value")] = 8.333
    return replace(entry, values=values)


#: Each with the rules that it breaks: the standing robot at tick 250, its move at 80, the circle at 1200.
CHANGES: list[tuple[str, Callable[[Session, Entry], Entry | None], set[str]]] = [
    ("lost tick", lambda _, e: None if e.values is not None and e.values[TICK] == 250 else e, {"time"}),
    ("wrong count", once(250, skip), {"time"}),
    ("far out", add(250, "command", 0.06), {"position", "velocity", "acceleration", "jerk", "arming"}),
    ("jump", add(250, "command", 0.001), {"velocity", "acceleration", "jerk", "arming"}),
    ("jolt", add(250, "command", 4e-5), {"acceleration", "jerk"}),
    ("jerk", add(80, "command", 8e-6), {"jerk"}),
    ("jump at arming", add(0, "value", 0.3), {"arming", "follow"}),
    ("frozen encoder", frozen, {"arming", "follow"}),
    ("deaf to the stop", once(410, mode(Mode.HOLD)), {"estop"}),
    ("fault in silence", once(250, mode(Mode.FAULT)), {"fault"}),
]


@pytest.mark.parametrize(("change", "expected"), [each[1:] for each in CHANGES], ids=[c[0] for c in CHANGES])
def test_every_rule_finds_what_breaks_it(
    run: Path, change: Callable[[Session, Entry], Entry | None], expected: set[str]
) -> None:
    assert rules(Changed(run, change)) == expected


@pytest.mark.parametrize(("ago", "value", "expected"), [
    (1, 0.3, set()), (2, 0.3, set()), (1, math.nan, {"arming"})
])  # fmt: skip
def test_arming_begins_at_one_of_the_last_two_measurements(
    run: Path, ago: int, value: float, expected: set[str]
) -> None:
    """Noise moves the measurements between the one that arming begins at and the first command."""
    session = Session(run)
    records = (session.layout.decode(tuple(e.values)) for e in session.entries() if e.values is not None)
    first = next(r.tick for r in records if not math.isnan(r.robots[0].axes[0].device))

    def change(session: Session, values: list[float]) -> None:
        values[session.layout.axis_place(0, 0, "value")] += value

    assert rules(Changed(run, once(first - ago, change))) == expected


def lagging(limited: bool) -> Callable[[Session, Entry], Entry]:
    """A command that stays behind its plan for a tick, and is back on it two ticks later."""

    def change(session: Session, entry: Entry) -> Entry:
        if entry.values is None or not 80 <= entry.values[TICK] <= 81:
            return entry
        values = list(entry.values)
        values[session.layout.axis_place(0, 0, "command")] += 8e-6
        values[session.layout.axis_place(0, 0, "limits")] = (
            4.0 if limited and entry.values[TICK] == 80 else 0.0
        )
        return replace(entry, values=values)

    return change


def test_the_way_back_to_the_plan_after_a_limit_is_not_limited_in_jerk(run: Path) -> None:
    assert rules(Changed(run, lagging(limited=False))) == {"jerk"}
    assert rules(Changed(run, lagging(limited=True))) == set()

    def jolt_later(session: Session, entry: Entry) -> Entry:
        return add(100, "command", 8e-6)(session, lagging(limited=True)(session, entry))

    assert rules(Changed(run, jolt_later)) == {"jerk"}


def test_a_fault_without_its_event_and_without_its_order(tmp_path: Path) -> None:
    path = RUNS["faulty_fingers"](tmp_path / "run.mcap")
    assert rules(Changed(path, without(FaultLatched))) == {"fault"}
    assert rules(Changed(path, without(OrderGiven))) == set()


class Cleared(Session):
    """A fault of some ticks in the standing robot, cleared by an order that takes some; events come early."""

    def __init__(self, path: Path, ordered: bool, early: int) -> None:
        super().__init__(path)
        self._ordered, self._early = ordered, early

    def entries(self) -> Iterator[Entry]:
        latched = FaultLatched(robot="f0", fault=0, name="NONE", message="", tick=240)
        clear = OrderGiven(tick=250, order={"order": "clear_fault", "robots": None})
        for entry in super().entries():
            tick = None if entry.values is None else int(entry.values[TICK])
            if tick == 240 - self._early:
                yield Entry(entry.time_ns, None, latched)
            if tick == 250 - self._early and self._ordered:
                yield Entry(entry.time_ns, None, clear)
            if tick is not None and 240 <= tick < 260:
                values = list(entry.values or ())
                mode(Mode.FAULT)(self, values)
                entry = replace(entry, values=values)
            yield entry


@pytest.mark.parametrize("early", [0, 1, 5])
def test_a_fault_that_takes_ticks_to_clear_and_events_of_a_late_recorder(run: Path, early: int) -> None:
    assert rules(Cleared(run, ordered=True, early=early)) == set()
    assert rules(Cleared(run, ordered=False, early=early)) == {"fault"}


def test_the_command_lists_violations_and_ends_with_1(run: Path, tmp_path: Path) -> None:
    done = contid("session", "check", str(run), "--json")
    assert (done.returncode, json.loads(done.stdout)) == (0, {"ok": True, "more": False, "violations": []})
    assert contid("session", "check", str(run)).stdout == "no rule of motion was broken\n"
    # The run of a fast robot, recorded with the file of a slow one.
    slow = parse_robot_file(fingers(1).replace("velocity_mm_s: 100", "velocity_mm_s: 10"), "fingers.yaml")
    recording = RecordingObserver(tmp_path / "slow.mcap", {"mock": "False", "input": "test"}, host="test")
    loaded = load(1)
    sink = recording.follow(RunSetup(slow, 200.0, tmp_path, None, OnEnd.STOP, attended=False))
    run_virtual(loaded, 200.0, circle(loaded), sinks=[sink])
    recording.detach()
    done = contid("session", "check", str(tmp_path / "slow.mcap"))
    assert done.returncode == 1
    lines = done.stdout.splitlines()
    assert len(lines) == MAX_VIOLATIONS + 1
    assert all("f0: velocity: f0." in line for line in lines[:-1])


def test_a_recording_without_ticks_is_not_found_right(tmp_path: Path) -> None:
    recording = RecordingObserver(tmp_path / "none.mcap", {"mock": "False", "input": "test"}, host="test")
    recording.follow(RunSetup(load(1), 200.0, tmp_path, None, OnEnd.STOP, attended=False))
    recording.detach()
    done = CliRunner().invoke(command, [str(tmp_path / "none.mcap")])
    assert isinstance(done.exception, SessionError)
    assert "has no tick" in str(done.exception)
    assert not done.stdout


def test_a_motion_that_the_tensions_limit_breaks_no_rule(configs: Path, tmp_path: Path) -> None:
    """Tensions hold it up now and then; the way back to the plan is limited, but not in jerk."""
    loaded = with_mock(load_robot_file(configs / "tendon3.yaml"))
    tips = (0.0014, 0.0188, 0.301), (0.0149, -0.0039, 0.3111)
    orders: dict[int, list[msg.Message]] = {
        30 + 120 * n: [msg.Goto("arm", Target(tip_m=tip))] for n, tip in enumerate(tips)
    }
    path = record_virtual(tmp_path / "run.mcap", loaded, None, orders, ticks=250, rate_hz=100.0)
    assert list(check_session(Session(path))) == []


@pytest.mark.parametrize("share", [0.0, 0.33, -1.0])
def test_a_body_that_did_not_follow_broke_a_rule(tmp_path: Path, share: float) -> None:
    loaded = load(1, options=f"faults:\n  - {{at_s: 1.5, axis: f0.left, kind: scaled, share: {share}}}\n")
    path = record_virtual(tmp_path / "away.mcap", loaded, circle(loaded, period_s=2.0))
    found = [each for each in check_session(Session(path)) if each.rule == "follow"]
    assert found
    assert "fault 112" in found[0].message
