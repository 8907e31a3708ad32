"""What must hold of a run that clients and faults fought over: from its recording and its devices' journals.

Answers are judged by the model of the lease (`tests.remote.orders.history`), commands by the rules of motion
(`contid_sessions.check`) and by a replay, torque by the journals, the exit code by the last records.
"""

from __future__ import annotations

import bisect
import json
import math
import traceback
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import yaml

from contid.control.engine.cycle import Timing
from contid.control.engine.engine import Engine
from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import BusAnswered, BusStalled, DeviceFaultChanged
from contid.control.engine.events.robots import GotoEnded, OrderGiven
from contid.control.engine.events.run import LogWritten
from contid.control.engine.tick_layout import ENABLED, UNRESTED, TickRecord
from contid.control.engine.wiring import build_robot_configs, record_layout
from contid.control.tick.config import RobotConfig
from contid.control.tick.supervisor import Mode
from contid.errors import ContidError
from contid.robot_file.load import LoadedFile, parse_robot_file
from contid.session.read import Session
from contid_sessions.check import check_session
from contid_sessions.replay.recorded_orders import answer_of, order_of
from contid_sessions.replay.recorded_port import RecordedPort, RecordedTick, slots_of
from contid_sessions.replay.replay import replay
from tests.remote.orders.history import GOES, LEFT, MOVING, STOPS, History, Order

if TYPE_CHECKING:
    from tests.campaign.clients.failing_devices import Case

#: Orders that arm robots, and orders after which only those arm them.
ARMS = frozenset({"resume", "recover"})
#: Faults by which no body lags behind its commands.
NOT_BEHIND = frozenset({"silent", "stale", "overload", "lost"})
#: After a tick, its exchange may take so long [s].
EXCHANGE_S = 0.002


class Seen:
    """A recording and the journals of the devices.

    Attributes:
        records: of the ticks.
        events: in order.
        given: orders with their ticks, in the order in which they were carried out.
        configs: by name of the robot.
        journal: by axis, times and states of its device.
    """

    def __init__(self, case: Case, session: Session | None = None) -> None:
        self.case = case
        self.session = session or Session(case.folder / "s.mcap")
        self.records: list[TickRecord] = []
        self.events: list[RunEvent] = []
        for entry in self.session.entries():
            if entry.event is not None:
                self.events.append(entry.event)
            elif entry.values is not None:
                self.records.append(self.session.layout.decode(tuple(entry.values)))
        self.loaded = self.session.robot_file()
        self.configs = {c.name: c for c in build_robot_configs(self.loaded, self.session.rate_hz)}
        self.places = {robot.name: place for place, robot in enumerate(self.session.layout.robots)}
        self.given = [(e.tick, e.order) for e in self.events if isinstance(e, OrderGiven)]
        self.times = [record.deadline_s for record in self.records]
        self.at = {record.tick: place for place, record in enumerate(self.records)}
        self.journal: dict[str, tuple[list[float], list[dict[str, Any]]]] = {}
        self.notes: list[dict[str, Any]] = []
        for path in case.folder.glob("*.jsonl"):
            for line in path.read_text().splitlines():
                note = json.loads(line)
                self.notes.append(note)
                for axis, state in note["axes"].items():
                    times, states = self.journal.setdefault(axis, ([], []))
                    times.append(note["t_s"])
                    states.append({**state, "event": note["event"]})
        self.notes.sort(key=lambda note: note["t_s"])

    def tick_at(self, time_s: float) -> int:
        """Newest tick that began by a time."""
        place = bisect.bisect_right(self.times, time_s)
        return self.records[place - 1].tick if place else -1

    def mode(self, robot: str, place: int) -> str:
        return Mode(self.records[place].robots[self.places[robot]].mode).name

    def valid(self, robot: str, place: int) -> bool:
        """True when every device answered in a tick, and is at rest if it was asked to be."""
        record = self.records[place].robots[self.places[robot]]
        return not record.flags & UNRESTED and all(axis.valid == 1.0 for axis in record.axes)

    def end_s(self, place: int) -> float:
        """When the exchange of a tick was over."""
        record = self.records[place]
        return record.deadline_s + record.lateness_s + record.work_s + EXCHANGE_S

    def for_robot(self, robot: str) -> list[tuple[int, dict[str, Any]]]:
        """Orders that are for a robot, with their ticks."""
        return [(tick, order) for tick, order in self.given if _meant(order, robot)]

    def states(self, axis: str, begin_s: float, end_s: float) -> Iterator[tuple[float, dict[str, Any]]]:
        """States of a device at a time, and those that were noted up to another."""
        times, states = self.journal[axis]
        first = bisect.bisect_right(times, begin_s) - 1
        # A rest that a silent device gets later is not noted: what was noted before it is old.
        while 0 <= first < len(times) and states[first]["event"].endswith((" begins", " ends")):
            first += 1
        for at in range(max(first, 0), len(times)):
            if times[at] >= end_s:
                return
            yield times[at], states[at]


def _meant(order: dict[str, Any], robot: str) -> bool:
    """True for an order that is for a robot."""
    robots = order.get("robots")
    return order.get("robot", robot) == robot if robots is None else robot in robots


def checked(case: Case) -> list[str]:
    """Everything that was wrong."""
    if "Traceback" in case.stderr or "never retrieved" in case.stderr:
        return [case.stderr[-3000:]]
    try:
        seen = Seen(case)
    except ContidError as error:
        return [f"no recording: {error}: exit {case.code}: {case.stderr[-800:]}"]
    if not seen.records:
        return [f"no ticks: exit {case.code}: {case.stderr[-800:]}"]
    return [*checks(seen), *(f"exit_code: {each}" for each in exit_code(seen))]


def checks(seen: Seen) -> list[str]:
    """What was wrong in the recording of a run."""
    found = []
    for check in (answers, onsets, motion, replayed, alone, power, rest, moves, untouched):
        try:
            found += [f"{check.__name__}: {each}" for each in check(seen)]
        except Exception:  # a defect of the check is to be seen
            found.append(f"{check.__name__}: {traceback.format_exc()[-600:]}")
    return found


class _Lease(History):
    """The lease alone; states are judged here, robot by robot."""

    def _may_be_held(self, order: Order) -> bool:
        """Also by a move under way: it holds the lease up to its answer, also if that refuses."""
        return super()._may_be_held(order) or any(
            each.verb == "move" and each.ok is False and each.client != order.client
            and each.sent < order.answered and each.answered > order.sent for each in self.orders
        )  # fmt: skip

    def _states(self, order: Order) -> Iterator[str]:
        return iter(())

    def _onsets(self) -> Iterator[str]:
        return iter(())


def _with_ticks(seen: Seen) -> None:
    for order in seen.case.orders:
        order.sent_tick = seen.tick_at(order.sent)
        order.answered_tick = math.inf if order.answered == math.inf else seen.tick_at(order.answered)


def answers(seen: Seen) -> Iterator[str]:
    """Every order is answered once, with the states of the tick it names; the lease is kept."""
    _with_ticks(seen)
    orders = sorted(seen.case.orders, key=lambda each: each.sent)
    last_s = seen.times[-1]
    for order in orders:
        # The daemon ended before it answered.
        if order.ok is None and order.client not in seen.case.closed:
            seen.case.closed[order.client] = last_s
    lease = _Lease(orders, {}, seen.case.closed)  # type: ignore[arg-type]
    if seen.case.input:
        yield from (each for each in lease.wrong() if "never answered" in each)
    else:
        yield from lease.wrong()
    for order in orders:
        if (
            order.ok is None
            and order.sent < last_s - 3.0
            and (seen.case.closed.get(order.client, math.inf) > order.sent + 3.5)
        ):
            yield f"no answer within 3.5 s: {order}"
        if order.code == "no-answer":
            yield f"not confirmed: {order} {order.result}"
        if order.ok is False and not order.result.get("message", "").strip():
            yield f"refused without a reason: {order}"
        tick, robots = order.result.get("tick"), order.result.get("robots")
        if isinstance(tick, int) and tick in seen.at:
            if not order.sent_tick <= tick <= order.answered_tick:
                yield f"foreign tick {tick}: {order}"
            if isinstance(robots, dict):
                modes = {name: seen.mode(name, seen.at[tick]) for name in robots}
                if modes != robots:
                    yield f"foreign states: {order}, {order.result}; the record has {modes}"
            if order.ok and order.verb in STOPS:
                yield from _obeyed(seen, order, tick)
        if order.ok and order.verb == "clear_fault":
            for name, mode in order.result["robots"].items():
                if name in order.result["cleared"] and mode == "FAULT":
                    yield f"cleared, and in FAULT: {order} {order.result}"


def _obeyed(seen: Seen, order: Order, tick: int) -> Iterator[str]:
    """A stop that was answered is in the recording in its tick, and its robots do what was ordered."""
    named = order.fields.get("robots")
    mine = [
        o for t, o in seen.given
        if tick - 20 <= t <= tick and o["order"] == order.verb
        and (None if o.get("robots") is None else set(o["robots"])) == (None if named is None else set(named))
    ]  # fmt: skip
    if not mine:
        yield f"answered, and not recorded at {tick}: {order}"
    refused = order.result.get("refused", {})
    for name, mode in order.result["robots"].items():
        if name in refused:
            continue
        later = [o for t, o in seen.for_robot(name) if t == tick and o["order"] != order.verb]
        if later:
            continue  # other orders of the same tick
        allowed = {
            "estop": {"OFF", "FAULT"}, "stop": {"OFF", "FAULT", "STOPPING"},
            "hold": {"OFF", "HOLD", "FAULT", "READY", "CONNECTING", "ARMING", "STOPPING"},
        }[order.verb]  # fmt: skip
        if mode not in allowed:
            yield f"{name} is {mode} after {order}"


def _touches(order: Order, robot: str) -> bool:
    named = order.fields.get("robots")
    if order.verb == "move":
        columns = [*order.fields.get("target", ()), *order.fields.get("columns", ())]
        return any(column.startswith(f"{robot}.") for column in columns)
    return named is None or robot in named


def onsets(seen: Seen) -> Iterator[str]:
    """A robot begins to move by an order that no stop has ended, and never by itself."""
    if seen.case.input:
        return
    orders = sorted(seen.case.orders, key=lambda each: each.sent)
    lease = _Lease(orders, {}, seen.case.closed)  # type: ignore[arg-type]
    for robot in seen.configs:
        goes = [o for o in orders if o.verb in GOES and o.ok is not False and _touches(o, robot)]
        stops = [o for o in orders if o.verb in STOPS and o.ok and _touches(o, robot)]
        before = "ARMING"  # the run arms them at its start
        armed = False
        for place, record in enumerate(seen.records):
            mode = seen.mode(robot, place)
            if mode in MOVING and before not in MOVING and armed:
                stopped = max([s.sent for s in stops if s.result["tick"] < record.tick], default=-1.0)
                authors = [
                    o for o in goes
                    if o.sent_tick <= record.tick and o.answered > stopped
                    and not (o.ok is None and record.tick > seen.tick_at(
                        seen.case.closed.get(o.client, math.inf)) + LEFT)
                    and lease.bar(o) is None
                ]  # fmt: skip
                if not authors:
                    yield f"{robot}: {before} to {mode} at {record.tick} without an order"
            armed = armed or mode not in ("OFF", "CONNECTING", "READY", "ARMING")
            before = mode


def motion(seen: Seen) -> Iterator[str]:
    """The rules of motion; faults of the body are what was asked for."""
    for each in check_session(seen.session):
        # A path that is slowed, because a body is behind, has more than its own jerk (docs/decisions/0048).
        if each.rule != "follow" and (each.rule != "jerk" or not _may_lag(seen)):
            yield str(each)


def _faults(seen: Seen) -> list[tuple[str, dict[str, Any]]]:
    """Faults of the devices, each with its bus."""
    buses = yaml.safe_load(seen.case.text)["buses"]
    return [(name, fault) for name, bus in buses.items() for fault in bus["faults"]]


def _may_lag(seen: Seen) -> bool:
    """True when a fault may let a body be behind, so that the path of every robot is slowed."""
    return bool({fault["kind"] for _, fault in _faults(seen)} - NOT_BEHIND)


def replayed(seen: Seen) -> Iterator[str]:
    """Today's code gives the same commands to the recorded inputs."""
    result = replay(seen.session, seen.loaded)
    if result.divergence is not None or result.stopped:
        yield f"{result.divergence} {result.stopped}"


class _Last:
    """A sink that keeps the newest record."""

    def __init__(self) -> None:
        self.values: list[float] = []

    def write(self, values: list[float]) -> None:
        self.values = [*values]

    def event(self, event: RunEvent) -> None:
        """Not needed."""


def alone(seen: Seen) -> Iterator[str]:
    """A robot whose devices do not fail moves as it does without the others, by the same orders and samples.

    Bodies that lag slow every path, and a timed trajectory waits for all its robots: cases without them.
    """
    raw = yaml.safe_load(seen.case.text)
    faults = [(name, fault) for name, bus in raw["buses"].items() for fault in bus["faults"]]
    if {fault["kind"] for _, fault in faults} - {"silent", "stale", "overload", "lost"} or seen.case.input:
        return
    if any(order["order"] == "play" for _, order in seen.given):
        return
    for robot, config in seen.configs.items():
        buses = {axis["bus"] for axis in raw["robots"][robot]["axes"].values()}
        if any(
            name in buses if "axis" not in fault else fault["axis"] in config.axes for name, fault in faults
        ):
            continue
        text = yaml.safe_dump({**raw, "robots": {robot: raw["robots"][robot]}})
        yield from _as_alone(seen, robot, parse_robot_file(text, "alone.yaml"))


def _as_alone(seen: Seen, robot: str, loaded: LoadedFile) -> Iterator[str]:
    rate_hz, sink, recorded = seen.session.rate_hz, _Last(), RecordedTick()
    ports: Any = {
        bus.name: RecordedPort(bus.name, slots_of(seen.session, [axis for axis, _ in bus.axes]), recorded)
        for bus in loaded.buses.values() if bus.axes
    }  # fmt: skip
    engine = Engine(build_robot_configs(loaded, rate_hz), ports, rate_hz, sink, lambda: 0.0, attended=True)
    engine.arm()
    layout, place, waiting = record_layout(loaded, rate_hz), seen.places[robot], list[RunEvent]()
    for entry in seen.session.entries():
        if entry.event is not None:
            waiting.append(entry.event)
            continue
        values = entry.values
        assert values is not None
        record = seen.session.layout.decode(tuple(values))
        recorded.values, recorded.stalls = values, set()
        due = [e for e in waiting if getattr(e, "tick", record.tick) <= record.tick]
        waiting = [e for e in waiting if e not in due]
        for event in due:
            match event:
                case OrderGiven() if (mine := _for(event.order, robot)) is not None:
                    engine.obey(order_of(OrderGiven(tick=event.tick, order=mine)), record.tick)
                case BusAnswered() if event.bus in ports:
                    own = sorted({index for index, _ in event.done} | {index for index, *_ in event.refused})
                    theirs = [index for index in own if index != place]
                    done = [[0, what] for index, what in event.done if index == place]
                    if done or event.lost or not theirs:
                        recorded.answers[event.bus] = answer_of(replace(event, done=done))
                case BusStalled() if event.bus in ports:
                    recorded.stalls.add(event.bus)
                case DeviceFaultChanged():
                    recorded.faults[event.axis] = event.fault
        engine.cycle(Timing(record.tick, record.skipped, record.deadline_s, record.lateness_s))
        mine_now, theirs_now = layout.decode(tuple(sink.values)).robots[0], record.robots[place]
        for a, b in zip(mine_now.axes, theirs_now.axes, strict=True):
            if a.device.hex() != b.device.hex() or mine_now.mode != theirs_now.mode:
                yield (
                    f"{robot} at {record.tick}: {Mode(theirs_now.mode).name} {b.device}, without the others "
                    f"{Mode(mine_now.mode).name} {a.device}"
                )
                return


def _for(order: dict[str, Any], robot: str) -> dict[str, Any] | None:
    """The part of an order that is for a robot."""
    if order["order"] == "goto" and order["robot"] != robot:
        return None
    if order["order"] == "rows":
        targets = {name: each for name, each in order["targets"].items() if name == robot}
        return {**order, "targets": targets} if targets else None
    if order.get("robots") is not None:
        return {**order, "robots": [robot]} if robot in order["robots"] else None
    return order


def power(seen: Seen) -> Iterator[str]:
    """Devices obey commands only after an order to arm that no stop followed."""
    for robot, config in seen.configs.items():
        given = [
            (seen.times[seen.at[tick]] if tick in seen.at else -1.0, order["order"])
            for tick, order in seen.for_robot(robot) if order["order"] in {*ARMS, "estop", "stop", "finish"}
        ]  # fmt: skip
        for note in seen.notes:
            axes = set(note["subject"].split(", ")) & set(config.axes)
            if note["event"] != "enable" or not axes:
                continue
            before = [what for at_s, what in given if at_s <= note["t_s"]]
            # A bus that takes longer than a tick is still at the requests of the one before; it rests next.
            soon = any(
                each["event"] == "disable" and axes & set(each["subject"].split(", "))
                and 0.0 <= each["t_s"] - note["t_s"] < 0.2 for each in seen.notes
            )  # fmt: skip
            if before and before[-1] not in ARMS and not soon:
                yield f"{robot}: {sorted(axes)} enabled at {note['t_s']:.4f} after {before[-3:]}"


def rest(seen: Seen) -> Iterator[str]:
    """A robot that is OFF has devices at rest, and one that was stopped by an estop has no torque."""
    last_s = seen.times[-1] + 1.0
    for robot, config in seen.configs.items():
        given = seen.for_robot(robot)
        for number, (tick, order) in enumerate(given):
            if order["order"] != "estop" or tick not in seen.at:
                continue
            arms = [t for t, o in given[number + 1 :] if o["order"] in ARMS]
            end_s = seen.times[seen.at[arms[0]]] if arms and arms[0] in seen.at else last_s
            place = next(
                (
                    at for at in range(seen.at[tick], len(seen.records))
                    if all(seen.valid(robot, min(k, len(seen.records) - 1)) for k in range(at, at + 2))
                ),
                None,
            )  # fmt: skip
            if place is None:
                continue
            begin_s = (
                seen.end_s(place)
                if place == seen.at[tick]
                else seen.end_s(min(place + 1, len(seen.records) - 1))
            )
            for axis in config.axes:
                for at_s, state in seen.states(axis, begin_s, end_s):
                    if state["on"] or state["rest"] not in ("relax", "vent"):
                        now = "on" if state["on"] else state["rest"]
                        yield f"{axis} is {now} at {at_s:.4f} ({state['event']}) after the estop at {tick}"
                        break
        for place in range(1, len(seen.records) - 2):
            record = seen.records[place].robots[seen.places[robot]]
            mode = Mode(record.mode)
            idle = mode is Mode.OFF or (mode is Mode.FAULT and not record.flags & ENABLED)
            if not idle or not all(seen.valid(robot, place + k) for k in (-1, 0, 1)):
                continue
            after = seen.records[place + 1].robots[seen.places[robot]]
            if after.mode != record.mode or after.flags & ENABLED:
                continue
            policies = (config.stops.on_fault, config.stops.on_interrupt)
            if any(policy.value not in ("relax", "vent") for policy in policies):
                continue  # devices that hold may be on
            found = [
                axis for axis in config.axes
                for at_s, state in [*seen.states(axis, seen.end_s(place), seen.end_s(place) + 1e-9)][:1]
                if state["on"]
            ]  # fmt: skip
            if found:
                yield f"{', '.join(found)} on while {robot} is {mode.name} at tick {seen.records[place].tick}"
                break


def moves(seen: Seen) -> Iterator[str]:
    """A move ends once, and one that reached its target did so by command and by measurement."""
    begun = {
        (o.client, o.result["move"]): o for o in seen.case.orders
        if o.ok and o.verb == "move" and "move" in o.result
    }  # fmt: skip
    ended: dict[tuple[int, int], int] = {}
    for client, notice in seen.case.notices:
        key = (client, notice["move"])
        ended[key] = ended.get(key, 0) + 1
        order = begun.get(key)
        if order is None or not notice["reached"] or "target" not in order.fields:
            continue
        place = seen.at[seen.tick_at(notice["at_s"])]
        for robot in seen.configs:
            if not _touches(order, robot):
                continue
            yield from _reached(seen, robot, order, place)
    for key, count in ended.items():
        if count > 1:
            yield f"move {key} ended {count} times"
    last_s = seen.times[-1]
    for key, order in begun.items():
        late = last_s - order.answered > 8.0 and seen.case.closed.get(order.client, math.inf) > last_s - 0.5
        if key not in ended and late and "target" in order.fields:
            yield f"no end of {order}"


def _reached(seen: Seen, robot: str, order: Order, place: int) -> Iterator[str]:
    """In one of the ticks before the notice the robot was measured at the target."""
    config = seen.configs[robot]
    goal = {k.split(".", 1)[1]: v for k, v in order.fields["target"].items() if k.startswith(f"{robot}.")}
    best = math.inf
    for at in range(max(0, place - 80), place + 1):
        record = seen.records[at].robots[seen.places[robot]]
        values = [axis.value for axis in record.axes]
        if any(map(math.isnan, values)):
            continue
        measured = config.transmission.to_actuation(values)
        best = min(best, _off(config, measured, goal))
    if best > (3.0 if "x_mm" in goal else 0.05):
        yield f"{robot}: {order} reached, measured {best:.3g} off at best"


def _off(config: RobotConfig, actuation: tuple[float, ...], goal: dict[str, float]) -> float:
    if "x_mm" in goal:
        x, y, _ = config.frame.point_in_world(config.model.forward(actuation).tip_m)
        return math.hypot(1e3 * x - goal["x_mm"], 1e3 * y - goal["y_mm"])
    return max(abs(value / 1e5 - want) for value, want in zip(actuation, goal.values(), strict=True))


def exit_code(seen: Seen) -> Iterator[str]:
    """3 after a fault at the end, 0 only where the measured robots are at the end of the trajectory."""
    case, last = seen.case, seen.records[-1]
    faults = {
        name: last.robots[place].fault for name, place in seen.places.items() if last.robots[place].fault
    }
    reported = {
        name: robot["fault"] for name, robot in case.report.get("robots", {}).items() if robot["fault"]
    }
    if case.code not in (0, 3, 130):
        yield f"exit code {case.code}: {case.stderr[-500:]}"
    if faults and case.code != 3:
        yield f"exit code {case.code} with faults {faults}"
    if case.code == 3 and not faults and not reported:
        yield f"exit code 3 without a fault: {case.report.get('ending')} {case.report.get('problems')}"
    if case.code == 0:
        if not case.input:
            yield "exit code 0 of a run that was interrupted"
        rows = (case.folder / "c.csv").read_text().splitlines()
        head, tail = rows[0].split(","), [float(each) for each in rows[-1].split(",")]
        touched = {name for name in seen.configs for _, o in seen.for_robot(name)
                   if o["order"] not in ("measured", "finish", "grip")}  # fmt: skip
        for robot in ("f0", "f1"):
            goal = {c.split(".")[1]: v for c, v in zip(head, tail, strict=True) if c.startswith(f"{robot}.")}
            values = [axis.value for axis in last.robots[seen.places[robot]].axes]
            off = _off(seen.configs[robot], seen.configs[robot].transmission.to_actuation(values), goal)
            if off > 3.0 and robot not in touched:
                yield f"exit code 0, and {robot} is measured {off:.3g} mm from the end of its trajectory"
    for word in ("did not end", "stood still"):
        if word in case.stderr:
            yield case.stderr[-600:]


def untouched(seen: Seen) -> Iterator[str]:
    """Gotos end in the order that they have in the recording, each once; a log has no defect."""
    for event in seen.events:
        if isinstance(event, LogWritten) and ("Error" in event.message or "Traceback" in event.message):
            yield f"log: {event.message[:300]}"
    for robot in seen.configs:
        begun = sum(o["order"] == "goto" for _, o in seen.for_robot(robot))
        ended = sum(isinstance(e, GotoEnded) and e.robot == robot for e in seen.events)
        if ended > begun:
            yield f"{robot}: {ended} gotos ended, {begun} began"
