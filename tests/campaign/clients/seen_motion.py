"""What must hold of commands: the rules of motion (`contid_sessions.check`), a replay, and a replay alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import yaml

from contid.control.engine.cycle import Timing
from contid.control.engine.engine import Engine
from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import BusAnswered, BusStalled, DeviceFaultChanged
from contid.control.engine.events.robots import OrderGiven
from contid.control.engine.wiring import build_robot_configs, record_layout
from contid.control.tick.supervisor import Mode
from contid.robot_file.load import LoadedFile, parse_robot_file
from contid_sessions.check import check_session
from contid_sessions.replay.recorded_orders import answer_of, order_of
from contid_sessions.replay.recorded_port import RecordedPort, RecordedTick, slots_of
from contid_sessions.replay.replay import replay
from tests.campaign.clients.seen import Seen

#: Faults by which no body lags behind its commands.
NOT_BEHIND = frozenset({"silent", "stale", "overload", "lost"})


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
