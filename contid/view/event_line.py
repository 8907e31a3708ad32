"""Events of the ring as lines of the viewer's log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

LEVELS: Final = {
    "fault": "ERROR",
    "failed": "ERROR",
    "refused": "WARN",
    "bus": "WARN",
    "device": "WARN",
    "stall": "WARN",
    "skipped": "WARN",
    "viewer": "WARN",
    "warning": "WARN",
    "error": "ERROR",
    "critical": "CRITICAL",
}
#: Events for programs, too many for a log.
SILENT: Final = frozenset({"answer", "limit_name", "mark", "order", "report", "robot"})


def event_line(event: Mapping[str, Any]) -> str:
    """One line: the robot, what happened, further fields."""
    fields = {name: value for name, value in event.items() if name not in ("event", "tick") and value != ""}
    robot, message = fields.pop("robot", None), fields.pop("message", None)
    if message is None:
        rounded = (
            f"{name} {f'{value:.4g}' if isinstance(value, float) else value}"
            for name, value in fields.items()
        )
        message = ": ".join(filter(None, (event["event"], ", ".join(rounded))))
    return str(message) if robot is None else f"{robot}: {message}"
