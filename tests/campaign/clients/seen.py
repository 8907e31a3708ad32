"""A run that clients and faults fought over, read from its recording and the journals of its devices."""

from __future__ import annotations

import bisect
import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import OrderGiven
from contid.control.engine.tick_layout import UNRESTED, TickRecord
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.supervisor import Mode
from contid.session.read import Session

if TYPE_CHECKING:
    from tests.campaign.clients.failing_devices import Case

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
