"""Orders and bus answers as events, and back: the inputs of a tick that a record does not hold.

A replay needs five kinds of events besides the records: ``order``, ``overran``, ``answer``, ``stall`` and
``device`` (`contid.control.engine.events`). A bus with neither ``answer`` nor ``stall`` in a tick answered
with the samples of the record.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Final, get_args

from contid.control.engine import messages as msg
from contid.control.engine.events.buses import BusAnswered
from contid.control.engine.events.robots import OrderGiven
from contid.control.engine.ports import BusReply
from contid.control.tick.faults import Fault
from contid.control.tick.state import Effect
from contid.errors import ContidError
from contid.robot_file.base import StopPolicy
from contid.targets import ZERO3, Target

#: Orders whose event has the fields of the message, by name.
_AS_THEY_ARE: Final[dict[str, type[msg.Message]]] = {
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
    if name not in _AS_THEY_ARE:
        return None
    return {"order": name, **{each.name: getattr(message, each.name) for each in fields(_AS_THEY_ARE[name])}}


def order_of(event: OrderGiven) -> msg.Message:
    """The message of an event.

    Raises:
        ContidError: an unknown order, or one whose event does not hold all of it (a trajectory).
        ValueError, KeyError, TypeError, AttributeError: its keys are damaged.
    """
    order = event.order
    kind = order["order"]
    if kind in _AS_THEY_ARE:
        given = {each.name: order[each.name] for each in fields(_AS_THEY_ARE[kind]) if each.name in order}
        if given.get("robots") is not None:
            given["robots"] = tuple(given["robots"])
        if given.get("policy") is not None:
            given["policy"] = StopPolicy(given["policy"])
        return _AS_THEY_ARE[kind](**given)
    match kind:
        case msg.Rows.NAME:
            # Recordings of earlier versions have one event per robot of a row.
            before = {order["robot"]: order["target"]} if "robot" in order else {}
            targets = order.get("targets", before)
            return msg.Rows({robot: target_of(each) for robot, each in targets.items()})
        case msg.Measured.NAME:
            x, y, z = order["tip_m"]
            direction = order.get("direction")
            # Recordings of earlier versions have neither direction nor age.
            return msg.Measured(
                order["robot"],
                (x, y, z),
                None if direction is None else tuple(direction),
                order.get("age_s", 0.0),
            )
        case msg.Goto.NAME:
            target = target_of(order["target"])
            if target is not None:
                force_n = order.get("until_force_n")
                return msg.Goto(order["robot"], target, None if force_n is None else float(force_n))
    raise ContidError(f"tick {event.tick}: the order {kind!r} cannot be repeated from a recording")


def answer_event(answer: BusReply, bus: str, tick: int) -> BusAnswered:
    """The event of an answer; it leaves the samples out, which are in the record of the tick."""
    done = [[robot, effect.name] for robot, effect in answer.done]
    refused = [[robot, effect.name, message] for robot, effect, message in answer.refused]
    return BusAnswered(
        tick=tick, bus=bus, lost=answer.lost, done=done, refused=refused, fault=int(answer.fault)
    )


def answer_of(event: BusAnswered) -> BusReply:
    """The answer of an event; its samples are in the record of the tick."""
    return BusReply(
        None,
        event.lost,
        [(robot, Effect[name]) for robot, name in event.done],
        [(robot, Effect[name], message) for robot, name, message in event.refused],
        Fault(event.fault),
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


def target_of(values: Mapping[str, Any] | None) -> Target | None:
    """The target of an ``order`` event."""
    if values is None:
        return None
    given: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
    return Target(**given)
