"""Orders and bus answers of the events of a recording; see `contid.control.engine.order_events`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from contid.control.engine import messages as msg
from contid.control.engine.events.buses import BusAnswered
from contid.control.engine.events.robots import OrderGiven
from contid.control.engine.order_events import AS_THEY_ARE
from contid.control.engine.ports import BusReply
from contid.control.tick.faults import Fault
from contid.control.tick.state import Effect
from contid.errors import ContidError
from contid.robot_file.base import StopPolicy
from contid.targets import Target


def order_of(event: OrderGiven) -> msg.Message:
    """The message of an event.

    Raises:
        ContidError: an unknown order, or one whose event does not hold all of it (a trajectory).
        ValueError, KeyError, TypeError, AttributeError: its keys are damaged.
    """
    order = event.order
    kind = order["order"]
    if kind in AS_THEY_ARE:
        given = {each.name: order[each.name] for each in fields(AS_THEY_ARE[kind]) if each.name in order}
        if given.get("robots") is not None:
            given["robots"] = tuple(given["robots"])
        if given.get("policy") is not None:
            given["policy"] = StopPolicy(given["policy"])
        return AS_THEY_ARE[kind](**given)
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


def answer_of(event: BusAnswered) -> BusReply:
    """The answer of an event; its samples are in the record of the tick."""
    return BusReply(
        None,
        event.lost,
        [(robot, Effect[name]) for robot, name in event.done],
        [(robot, Effect[name], message) for robot, name, message in event.refused],
        Fault(event.fault),
    )


def target_of(values: Mapping[str, Any] | None) -> Target | None:
    """The target of an ``order`` event."""
    if values is None:
        return None
    given: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
    return Target(**given)
