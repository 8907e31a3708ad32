"""What becomes of orders: given, refused, carried out."""

from __future__ import annotations

from typing import Annotated, Any

from contid.control.engine.events.base import RobotName, RunEvent, Text, TickNumber, run_event


@run_event("order")
class OrderGiven(RunEvent):
    """An order reached the engine before a tick; its JSON has the keys of ``order`` itself."""

    tick: TickNumber
    order: Annotated[dict[str, Any], "which order"]


@run_event("refused")
class OrderRefused(RunEvent):
    """An order, or a part of one, was not carried out."""

    robot: RobotName = ""
    message: Text


@run_event("mark")
class MarkReached(RunEvent):
    """Every order sent before a `contid.control.engine.messages.Mark` was carried out or refused."""

    number: Annotated[int, "of the mark"]
    tick: TickNumber


@run_event("goto")
class GotoEnded(RunEvent):
    """A robot reached the target of a goto, or gave up on it."""

    robot: RobotName
    arrived: Annotated[bool, "the robot holds at the target"]
    tick: TickNumber
