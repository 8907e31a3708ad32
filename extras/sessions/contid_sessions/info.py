"""Summary of a session, from one pass through it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import RecorderOverrun
from contid.control.engine.events.json_form import to_json
from contid.control.engine.events.robots import FaultLatched
from contid.control.engine.events.run import LogWritten
from contid.control.engine.tick_layout import DEADLINE, LATENESS, SKIPPED, TICK
from contid.control.tick.supervisor import Mode
from contid.session.format.entries import DAMAGED, GROWING
from contid.session.read import Session

#: Events that a summary lists; the others are counted only.
_LISTED = (
    "refused", "contact", "squeeze", "path", "bus", "tier", "overrun", "skipped", "recorder", "failed", "end",
    "stopping",
)  # fmt: skip
_MAX_LISTED = 20


@dataclass(slots=True)
class Info:
    """A summary.

    Attributes:
        file: path of the session.
        bytes: size of the file.
        state: ``clean`` or why not.
        compacted: indexed and compressed.
        began: UTC, ISO 8601.
        duration_s: time from the first tick to the last [s].
        ticks: number of recorded ticks.
        rate_hz: ticks per second.
        virtual: recorded in virtual time.
        late: ticks that started more than a tenth of a period after their deadline; in virtual time those
            behind a simulated device that answered late.
        skipped: ticks that were not started.
        waited: periods that passed while devices were connected, armed or cleared.
        longest_gap_ms: longest time between two recorded ticks with skipped or waited ones between them; 0
            without any.
        lost: ticks that the recorder missed.
        robots: model, axes and last mode by name.
        input: name of the trajectory and its number of rows, or ``live``.
        faults: tick, robot and message of each.
        events: number of each kind.
        listed: important events with their tick.
        versions: versions of contid and its libraries, by name.
    """

    file: str
    bytes: int = 0
    state: str = ""
    compacted: bool = False
    began: str = ""
    duration_s: float = 0.0
    ticks: int = 0
    rate_hz: float = 0.0
    virtual: bool = False
    late: int = 0
    skipped: int = 0
    waited: int = 0
    longest_gap_ms: float = 0.0
    lost: int = 0
    robots: dict[str, dict[str, Any]] = field(default_factory=dict)
    input: str = ""
    faults: list[str] = field(default_factory=list)
    events: dict[str, int] = field(default_factory=dict)
    listed: list[str] = field(default_factory=list)
    versions: dict[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        """The summary as lines of text."""
        size = f"{self.bytes / 1e6:.3g} MB" + (", compacted" if self.compacted else "")
        slower = " or by overload" if "overload" in self.events else ""
        lines = [
            f"{self.file}: {self.state}, {size}",
            f"began {self.began}, {self.duration_s:.2f} s{' of virtual time' if self.virtual else ''}",
            f"ticks: {self.ticks} at {self.rate_hz:g} Hz, {self.late} late, {self.skipped} skipped"
            + (f", {self.waited} waited for arming{slower}" if self.waited else "")
            + (f", longest gap {self.longest_gap_ms:.0f} ms" if self.longest_gap_ms else "")
            + (f", {self.lost} not recorded" if self.lost else ""),
            f"input: {self.input}",
        ]
        for name, robot in self.robots.items():
            lines.append(f"{name}: {robot['model']}, axes {', '.join(robot['axes'])}; last {robot['mode']}")
        lines += [f"fault: {message}" for message in self.faults] or ["no fault"]
        lines.append("events: " + (", ".join(f"{n} {kind}" for kind, n in self.events.items()) or "none"))
        lines += [f"  {line}" for line in self.listed]
        lines.append(", ".join(f"{name} {value}" for name, value in self.versions.items()))
        return "\n".join(lines)


def summarize(session: Session) -> Info:
    """Read a session once."""
    versions = session.metadata["contid"]
    info = Info(str(session.path), session.path.stat().st_size, rate_hz=session.rate_hz)
    info.began, info.virtual, info.input = (
        versions.get("created", "unknown"),
        session.virtual,
        _input(session),
    )
    info.versions = {name: text for name, text in versions.items() if name not in ("format", "created")}
    kinds: Counter[str] = Counter()
    first_ns = last_ns = 0
    last: list[float] | None = None
    late_s = 0.1 / session.rate_hz
    for entry in session.entries():
        if entry.values is None:
            assert entry.event is not None
            _add_event(info, kinds, entry.event)
            continue
        if last is not None:
            _add_gap(info, last, entry.values)
        last = entry.values
        first_ns, last_ns = first_ns or entry.time_ns, entry.time_ns
        info.ticks += 1
        info.late += last[LATENESS] > late_s
        info.skipped = int(last[SKIPPED])
    info.duration_s = (last_ns - first_ns) / 1e9
    info.events = dict(sorted(kinds.items()))
    info.compacted = session.end.compacted
    info.state = _state(session, info.ticks)
    if "repaired" in session.metadata:
        info.state += f", repaired {session.metadata['repaired'].get('when', '')}".rstrip()
    for index, robot in enumerate(session.layout.robots):
        mode = "unknown" if last is None else name_of(Mode, last[session.layout.robot_place(index, "mode")])
        info.robots[robot.name] = {"model": robot.model, "axes": list(robot.axes), "mode": mode}
    return info


def _add_gap(info: Info, before: list[float], now: list[float]) -> None:
    """Count the waited and skipped periods between two recorded ticks.

    Ticks that ran but that the recorder missed are neither.
    """
    periods = round((now[DEADLINE] - before[DEADLINE]) * info.rate_hz)
    waited, skipped = periods - int(now[TICK] - before[TICK]), int(now[SKIPPED] - before[SKIPPED])
    info.waited += waited
    if (waited or skipped) and now[TICK] - before[TICK] == 1 + skipped:
        gap_s = now[DEADLINE] + now[LATENESS] - before[DEADLINE] - before[LATENESS]
        info.longest_gap_ms = max(info.longest_gap_ms, round(gap_s * 1e3, 3))


def _state(session: Session, ticks: int) -> str:
    if session.end.clean:
        return "clean"
    if session.end.cut == GROWING:
        return GROWING
    if session.end.cut == DAMAGED:
        return f"{DAMAGED} after {ticks} ticks ({session.end.damage}); what follows is not read"
    return f"cut off ({session.end.cut}); `contid session repair` completes it"


def _input(session: Session) -> str:
    trajectory = session.metadata.get("trajectory")
    name = session.option("input") or "none"
    return f"{name}, live" if trajectory is None else f"{name}, {trajectory.get('rows', '?')} rows"


def _add_event(info: Info, kinds: Counter[str], event: RunEvent) -> None:
    values = to_json(event)
    kind, tick = values.pop("event"), values.pop("tick", None)
    kinds[kind] += 1
    match event:
        case FaultLatched():
            info.faults.append(f"tick {tick}: {event.robot}: {event.message}")
        case RecorderOverrun():
            info.lost += event.missed_ticks
    listed = kind in _LISTED or (isinstance(event, LogWritten) and event.level not in ("debug", "info"))
    if listed and len(info.listed) < _MAX_LISTED:
        rest = ", ".join(
            f"{key} {f'{value:.3g}' if isinstance(value, float) else value}" for key, value in values.items()
        )
        info.listed.append(f"{'' if tick is None else f'tick {tick}: '}{kind}: {rest}")


def name_of(kind: type[IntEnum], value: float) -> str:
    """The name of a number in a record; the number itself if it has none in this version."""
    return next((each.name for each in kind if each == value), f"{value:g}")
