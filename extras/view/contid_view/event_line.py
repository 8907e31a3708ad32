"""Events of the ring as lines of the viewer's log."""

from __future__ import annotations

from typing import Final

from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import (
    BusAnswered,
    BusChanged,
    BusStalled,
    DeviceFaultChanged,
    OverloadChanged,
    PaceReported,
    TicksSkipped,
    TicksWaited,
    ViewerPaused,
)
from contid.control.engine.events.json_form import to_json
from contid.control.engine.events.robots import (
    ContactBegan,
    FaultLatched,
    LimitNamed,
    MarkReached,
    ModeChanged,
    OrderGiven,
    OrderRefused,
    RobotReported,
)
from contid.control.engine.events.run import LogWritten, NoteWritten, RunFailed

_WARNINGS: Final = (
    OrderRefused, ContactBegan, BusChanged, BusStalled, DeviceFaultChanged, OverloadChanged,
    TicksSkipped, ViewerPaused,
)  # fmt: skip
#: Levels of Rerun by kind; the others are INFO.
_LEVELS: Final = {
    **{kind.KIND: "WARN" for kind in _WARNINGS},
    **{kind.KIND: "ERROR" for kind in (FaultLatched, RunFailed)},
}
_LOG_LEVELS: Final = {"warning": "WARN", "error": "ERROR", "critical": "CRITICAL"}
#: Kinds of events for programs, too many for a log.
_SILENT: Final = frozenset(
    kind.KIND
    for kind in (
        BusAnswered, LimitNamed, MarkReached, NoteWritten, OrderGiven, PaceReported, RobotReported,
        TicksWaited,
    )
)  # fmt: skip


def event_line(event: RunEvent) -> tuple[str, str] | None:
    """Level and text (robot, what happened, further fields) of an event; None for those for programs."""
    fields = {name: value for name, value in to_json(event).items() if value != "" and name != "tick"}
    kind = fields.pop("event")
    if kind in _SILENT:
        return None
    level = _LOG_LEVELS.get(event.level) if isinstance(event, LogWritten) else _LEVELS.get(kind)
    if isinstance(event, ModeChanged):
        return "INFO", f"{event.robot}: {event.mode}"
    robot, text = fields.pop("robot", None), fields.pop("message", None)
    if text is None:
        rounded = {
            name: f"{value:.4g}" if isinstance(value, float) else value for name, value in fields.items()
        }
        text = ": ".join(
            filter(None, (kind, ", ".join(f"{name} {value}" for name, value in rounded.items())))
        )
    return level or "INFO", str(text) if robot is None else f"{robot}: {text}"
