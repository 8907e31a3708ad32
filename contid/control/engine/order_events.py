"""Orders and bus answers as events: the inputs of a tick that a record does not hold.

A replay needs five kinds of events besides the records: ``order``, ``overran``, ``answer``, ``stall`` and
``device`` (`contid.control.engine.events`). A bus with neither ``answer`` nor ``stall`` in a tick answered
with the samples of the record.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Final, get_args

from contid.control.engine import messages as msg
from contid.control.engine.events.buses import BusAnswered
from contid.control.engine.events.robots import OrderGiven
from contid.control.engine.ports import BusReply
from contid.targets import ZERO3, Target

#: Orders whose event has the fields of the message, by name.
AS_THEY_ARE: Final[dict[str, type[msg.Message]]] = {
    kind.NAME: kind
    for kind in get_args(msg.Message)
    if hasattr(kind, "NAME") and kind not in (msg.Rows, msg.Goto, msg.Measured, msg.Play)
}


def order_event(message: object, tick: int) -> OrderGiven | None:
    """The event of an order obeyed before a tick; None for a message that is no order."""
    if isinstance(message, msg.Rows):
        return rows_event(message, tick)
    order = _order(message)
    return None if order is None else OrderGiven(tick=tick, order=order)


def rows_event(row: msg.Rows, tick: int) -> OrderGiven:
    """The event of a row of a live stream."""
    targets = {robot: _target(each) for robot, each in row.targets.items()}
    return OrderGiven(tick=tick, order={"order": msg.Rows.NAME, "targets": targets})


def _order(message: object) -> dict[str, Any] | None:
    match message:
        case msg.Goto(robot, target, force_n):
            goto: dict[str, Any] = {"order": msg.Goto.NAME, "robot": robot, "target": _target(target)}
            return goto if force_n is None else {**goto, "until_force_n": force_n}
        case msg.Measured(robot, tip_in_world, direction, age_s):
            seen = {"order": msg.Measured.NAME, "robot": robot, "tip_m": tip_in_world, "age_s": age_s}
            return seen if direction is None else {**seen, "direction": direction}
        case msg.Play(trajectory, waits):
            played = {"order": msg.Play.NAME, "rows": len(trajectory)}
            return {**played, "waits": True} if waits else played
    name = getattr(message, "NAME", "")
    if name not in AS_THEY_ARE:
        return None
    return {"order": name, **{each.name: getattr(message, each.name) for each in fields(AS_THEY_ARE[name])}}


def answer_event(answer: BusReply, bus: str, tick: int) -> BusAnswered:
    """The event of an answer; it leaves the samples out, which are in the record of the tick."""
    done = [[robot, effect.name] for robot, effect in answer.done]
    refused = [[robot, effect.name, message] for robot, effect, message in answer.refused]
    return BusAnswered(
        tick=tick, bus=bus, lost=answer.lost, done=done, refused=refused, fault=int(answer.fault)
    )


def _target(target: Target | None) -> dict[str, Any] | None:
    """The fields of a target that are set; floats survive JSON exactly."""
    if target is None:
        return None
    values = {
        "tip_m": target.tip_m,
        "direction": target.direction,
        "rotation": target.rotation,
        "mid_m": target.mid_m,
        "actuation": target.actuation,
        "arcs": target.arcs,
        "load_n": target.load_n if target.load_n != ZERO3 else None,
        "extra": dict(target.extra) or None,
        "measured_tip_m": target.measured_tip_m,
        "measured_direction": target.measured_direction,
    }
    return {name: value for name, value in values.items() if value is not None}
