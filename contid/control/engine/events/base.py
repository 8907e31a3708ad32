"""Base of all events, and the annotated types of the fields that many of them have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, TypeAlias

TickNumber: TypeAlias = Annotated[int, "number of the tick it belongs to"]
RobotName: TypeAlias = Annotated[str, "name of the robot"]
BusName: TypeAlias = Annotated[str, "name of the bus"]
Text: TypeAlias = Annotated[str, "text for a person"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEvent:
    """Base of all events; ``KIND`` is the value of ``event`` in their JSON."""

    KIND: ClassVar[str] = ""
