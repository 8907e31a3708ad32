"""What a reader of the ring did not get: lost records, events that are too long or unknown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from contid.control.engine.events.base import RunEvent, Text, run_event


@run_event("recorder")
class RecorderFailed(RunEvent):
    """The control process ended without closing the ring."""

    message: Text


@run_event("overrun")
class RecorderOverrun(RunEvent):
    """The ring was overwritten before the recorder had read it."""

    missed_ticks: Annotated[int, "ticks that are not in the file"]
    missed_events: Annotated[int, "events that are not in the file"]


@run_event("viewer")
class ViewerPaused(RunEvent):
    """The ring was overwritten before the viewer had read it; written by the viewer."""

    message: Text


@run_event("too_long")
class EventTooLong(RunEvent):
    """Replaces an event that does not fit into the ring."""

    kind: Annotated[str, "of the event"]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownEvent(RunEvent):
    """An event of another version, or a damaged one."""

    kind: str
    values: Mapping[str, Any]
