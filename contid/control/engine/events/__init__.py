"""The events of a run as types; their JSON and its schema derive from the fields declared here.

The control process writes them into the ring, the recorder into the session file. Daemon, server and viewer
match on the types. An event of a kind or with values that this version does not know is an `UnknownEvent`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, TypeAlias, TypeVar, dataclass_transform

TickNumber: TypeAlias = Annotated[int, "number of the tick it belongs to"]
RobotName: TypeAlias = Annotated[str, "name of the robot"]
BusName: TypeAlias = Annotated[str, "name of the bus"]
Text: TypeAlias = Annotated[str, "text for a person"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEvent:
    """Base of all events; ``KIND`` is the value of ``event`` in their JSON."""

    KIND: ClassVar[str] = ""


_Event = TypeVar("_Event", bound=RunEvent)


@dataclass_transform(frozen_default=True, kw_only_default=True)
def run_event(kind: str) -> Callable[[type[_Event]], type[_Event]]:
    """Decorator of the class of a kind of events: a frozen dataclass with this `RunEvent.KIND`."""

    def declare(event: type[_Event]) -> type[_Event]:
        event.KIND = kind
        return dataclass(frozen=True, slots=True, kw_only=True)(event)

    return declare
