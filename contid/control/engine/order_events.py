"""What a replay needs beside the records of the ticks: orders and what buses answered, as events and back.

A record holds what was sampled in a tick, not how it came about. Everything else that reaches a tick from
outside is rare, and becomes an event with the number of its tick:

* ``order``: a message of the daemon, obeyed before that tick;
* ``answer``: a bus that is gone or back, or that did or refused what was asked of it;
* ``stall``: a bus that was not back by the end of that tick;
* ``device``: an axis whose own fault changed.

A bus without ``answer`` and ``stall`` in a tick simply answered with the samples of the record.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from contid.control.engine import messages as msg
from contid.control.engine.ports import BusReply
from contid.control.tick.state import Effect
from contid.errors import ContidError
from contid.robot_file.base import StopPolicy
from contid.targets import ZERO3, Target

_FOR_ROBOTS: Final[dict[str, type[msg.Hold | msg.Resume | msg.Estop | msg.ClearFault]]] = {
    "hold": msg.Hold,
    "resume": msg.Resume,
    "estop": msg.Estop,
    "clear_fault": msg.ClearFault,
}
_NAMES: Final[dict[type, str]] = {kind: name for name, kind in _FOR_ROBOTS.items()}


def order_event(message: object) -> dict[str, Any] | None:
    """A message as the fields of its ``order`` event; None for what is no order."""
    match message:
        case msg.Rows(targets):
            return {"order": "rows", "targets": {robot: _target(each) for robot, each in targets.items()}}
        case msg.Goto(robot, target):
            return {"order": "goto", "robot": robot, "target": _target(target)}
        case msg.Measured(robot, tip_in_world, direction, age_s):
            fields = {"order": "measured", "robot": robot, "tip_m": tip_in_world, "age_s": age_s}
            return fields if direction is None else {**fields, "direction": direction}
        case msg.Stop(robots, policy, reason):
            return {"order": "stop", "robots": robots, "policy": policy, "reason": reason}
        case msg.Finish(policy, reason):
            return {"order": "finish", "policy": policy, "reason": reason}
        case msg.Hold(robots) | msg.Resume(robots) | msg.Estop(robots) | msg.ClearFault(robots):
            return {"order": _NAMES[type(message)], "robots": robots}
        case msg.EndOfRows():
            return {"order": "end"}
        case msg.Begin():
            return {"order": "begin"}
        case msg.Play(trajectory):
            return {"order": "play", "rows": len(trajectory)}
    return None


def order_of(event: Mapping[str, Any]) -> msg.Message:
    """The message of an ``order`` event.

    Raises:
        ContidError: this version does not know it, or an event does not hold it (a second trajectory).
    """
    kind = event["order"]
    policy = event.get("policy")
    stop = None if policy is None else StopPolicy(policy)
    robots = event.get("robots")
    if kind in _FOR_ROBOTS:
        return _FOR_ROBOTS[kind](None if robots is None else tuple(robots))
    match kind:
        case "rows":
            # Recordings of earlier versions have one event per robot of a row.
            before = {event["robot"]: event["target"]} if "robot" in event else {}
            targets = event.get("targets", before)
            return msg.Rows({robot: target_of(fields) for robot, fields in targets.items()})
        case "measured":
            x, y, z = event["tip_m"]
            direction = event.get("direction")
            # Recordings of earlier versions have neither direction nor age.
            return msg.Measured(
                event["robot"],
                (x, y, z),
                None if direction is None else tuple(direction),
                event.get("age_s", 0.0),
            )
        case "goto":
            target = target_of(event["target"])
            if target is not None:
                return msg.Goto(event["robot"], target)
        case "stop":
            return msg.Stop(None if robots is None else tuple(robots), stop, event["reason"])
        case "finish":
            return msg.Finish(stop, event["reason"])
        case "end":
            return msg.EndOfRows()
        case "begin":
            return msg.Begin()
    raise ContidError(f"tick {event.get('tick')}: the order {kind!r} cannot be repeated from a recording")


def answer_event(answer: BusReply) -> dict[str, Any]:
    """An answer without its samples, as the fields of an ``answer`` event."""
    return {
        "lost": answer.lost,
        "done": [[robot, effect.name] for robot, effect in answer.done],
        "refused": [[robot, effect.name, message] for robot, effect, message in answer.refused],
    }


def answer_of(event: Mapping[str, Any]) -> BusReply:
    """The answer of an ``answer`` event; its samples are in the record of the tick."""
    return BusReply(
        None,
        event["lost"],
        [(robot, Effect[name]) for robot, name in event["done"]],
        [(robot, Effect[name], message) for robot, name, message in event["refused"]],
    )


def _target(target: Target | None) -> dict[str, Any] | None:
    """A target by what it has; floats survive JSON exactly."""
    if target is None:
        return None
    fields = {
        "tip_m": target.tip_m,
        "direction": target.direction,
        "mid_m": target.mid_m,
        "actuation": target.actuation,
        "load_n": target.load_n if target.load_n != ZERO3 else None,
        "extra": dict(target.extra) or None,
        "measured_tip_m": target.measured_tip_m,
        "measured_direction": target.measured_direction,
    }
    return {name: value for name, value in fields.items() if value is not None}


def target_of(fields: Mapping[str, Any] | None) -> Target | None:
    """The target of an ``order`` event."""
    if fields is None:
        return None
    values: dict[str, Any] = {n: tuple(v) if isinstance(v, list) else v for n, v in fields.items()}
    return Target(**values)
