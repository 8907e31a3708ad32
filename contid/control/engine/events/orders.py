"""What becomes of orders: given, refused, carried out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from contid.control.engine.events.base import RobotName, RunEvent, Text, TickNumber


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderGiven(RunEvent):
    """An order reached the engine before a tick; its JSON has the keys of ``order`` itself."""

    KIND: ClassVar[str] = "order"
    tick: TickNumber
    order: Annotated[dict[str, Any], "which order"]


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderRefused(RunEvent):
    """An order, or a part of one, was not carried out."""

    KIND: ClassVar[str] = "refused"
    robot: RobotName = ""
    message: Text


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkReached(RunEvent):
    """Every order sent before a `contid.control.engine.messages.Mark` was carried out or refused."""

    KIND: ClassVar[str] = "mark"
    number: Annotated[int, "of the mark"]
    tick: TickNumber


@dataclass(frozen=True, slots=True, kw_only=True)
class GotoEnded(RunEvent):
    """A robot reached the target of a goto, or gave up on it."""

    KIND: ClassVar[str] = "goto"
    robot: RobotName
    arrived: Annotated[bool, "the robot holds at the target"]
    tick: TickNumber
