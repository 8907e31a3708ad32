"""What the channels of a session hold: which number of a record goes where in which JSON message.

A tick leaves one message on each of `TICK_CHANNELS`; ``event`` has one per event. Values are SI with the unit
in the key (``left_m``, ``p1_pa``, ``tip_m``); a dot in an axis name becomes an underscore, so that plotting
programs find the way. What a record has as NaN is absent: a number or a vector then has no key, integers,
booleans and objects are always there. Written by `contid.session.format.encode`, read by
`contid.session.format.decode`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from contid.control.engine.tick_layout import AXIS_VALUES, HEAD_VALUES, ROBOT_VALUES, RecordLayout

TICK_CHANNELS: Final = ("tick", "target", "solution", "command", "sample")
EVENT: Final = "event"
#: Of the messages; every one is read. 0 the first; 1 adds the measured tip of every robot; 2 leaves out what
#: is absent, where earlier ones have ``null``, and names what is infinite, where earlier ones have ``1e999``;
#: 3 renames keys of events (`RENAMED_EVENT_KEYS`).
REVISION: Final = 3
CHANNELS: Final = (*TICK_CHANNELS, EVENT)
#: Key of a message for what JSON cannot say: paths of infinite numbers, a minus in front of negative ones.
INFINITE: Final = "infinite"
#: Keys of events in revisions 0 to 2 -> their names from revision 3 on.
RENAMED_EVENT_KEYS: Final = {"words": "message"}
#: Unit in a robot file -> unit of SI.
SI: Final = {"mm": "m", "bar": "pa"}

# Places in a record, relative to its robot and to its axis (`contid.control.engine.tick_layout`).
_MODE, _FAULT, _FLAGS, _LIMITED_BY, _ITERATIONS = range(5)
_TIP, _DIRECTION, _MID, _LOAD = (5, 6, 7), (8, 9, 10), (11, 12, 13), (14, 15, 16)
_RESIDUAL, _TIP_ERROR = 17, 18
_MEASURED_TIP, _MEASURED_DIRECTION, _MEASURED_AGE = (19, 20, 21), (22, 23, 24), 25
TARGET, SOLUTION, COMMAND, LIMITS, DEVICE = range(5)
VALUE, TIME, VALID, AGE, VELOCITY, EFFORT, TEMPERATURE, VOLTAGE = range(5, 13)


@dataclass(frozen=True, slots=True)
class Field:
    """One value of a message.

    Attributes:
        path: keys from the message down to it.
        slots: places in the record; three make a vector.
        kind: JSON Schema type of it.
        message: what it is, for the schema.
    """

    path: tuple[str, ...]
    slots: tuple[int, ...]
    kind: str
    message: str

    @property
    def required(self) -> bool:
        """It is in every message; others are left out while a record has NaN there."""
        return self.kind in ("integer", "boolean")


def robot_at(layout: RecordLayout, index: int) -> int:
    """Place of the first value of a robot in a record."""
    before = sum(ROBOT_VALUES + AXIS_VALUES * len(robot.axes) for robot in layout.robots[:index])
    return HEAD_VALUES + before


def axis_at(layout: RecordLayout, robot: int, axis: int) -> int:
    """Place of the first value of an axis in a record."""
    return robot_at(layout, robot) + ROBOT_VALUES + AXIS_VALUES * axis


def key_of(axis: str) -> str:
    """An axis name as it stands in keys."""
    return axis.replace(".", "_")


def fields(layout: RecordLayout, device_units: Mapping[str, str], channel: str) -> Iterator[Field]:
    """Every value of a channel's messages, in order.

    Args:
        layout: of the records.
        device_units: ``rad`` or ``pa`` by ``ROBOT.AXIS``.
        channel: one of `TICK_CHANNELS`.
    """
    yield Field(("tick",), (0,), "integer", "number of the tick")
    if channel == "tick":
        yield Field(("skipped",), (1,), "integer", "ticks skipped so far")
        for slot, name, message in (
            (2, "deadline_s", "when it should have started, on CLOCK_MONOTONIC or in virtual time"),
            (3, "lateness_s", "how much later it started"),
            (4, "work_s", "how long it took"),
            (5, "source_s", "time in the trajectory"),
        ):
            yield Field((name,), (slot,), "number", message)
    for index, robot in enumerate(layout.robots):
        at, front, unit = robot_at(layout, index), ("robots", robot.name), SI[robot.quantity]
        for place, name, kind, message in _OF_ROBOT[channel]:
            slots = tuple(at + each for each in (place if isinstance(place, tuple) else (place,)))
            yield Field((*front, name), slots, kind, message)
        for number, axis in enumerate(robot.axes):
            start, key = axis_at(layout, index, number), key_of(axis)
            device = device_units[f"{robot.name}.{axis}"]
            if channel == "sample":
                for place, name, kind, message in _SAMPLE:
                    full = name.format(unit=device)
                    yield Field((*front, key, full), (start + place,), kind, message)
            elif channel in _ACTUATION:
                place, message = _ACTUATION[channel]
                yield Field((*front, f"{key}_{unit}"), (start + place,), "number", message)
        if channel == "command":
            for number, axis in enumerate(robot.axes):
                start, key = axis_at(layout, index, number), key_of(axis)
                path = (*front, "device", f"{key}_{device_units[f'{robot.name}.{axis}']}")
                yield Field(path, (start + DEVICE,), "number", "value sent to the device")
                message = "bits: 1 position, 2 velocity, 4 acceleration, 8 refused"
                yield Field((*front, "limits", key), (start + LIMITS,), "integer", message)


_MODES: Final = "0 OFF, 1 CONNECTING, 2 READY, 3 ARMING, 4 APPROACH, 5 RUN, 6 HOLD, 7 STOPPING, 8 FAULT"
_OF_ROBOT: Final[dict[str, tuple[tuple[int | tuple[int, ...], str, str, str], ...]]] = {
    "tick": (
        (_MODE, "mode", "integer", _MODES),
        (_FAULT, "fault", "integer", "0 none; `contid fault NUMBER` tells what another means"),
        (_FLAGS, "flags", "integer", "bits: 1 has a target, 2 converged, 4 devices enabled"),
    ),
    "target": (
        (_TIP, "tip_m", "array", "tip position in the world frame"),
        (_DIRECTION, "direction", "array", "unit tangent at the tip in the world frame"),
        (_MID, "mid_m", "array", "mid-point in the world frame"),
        (_LOAD, "load_n", "array", "known force on the tip in the world frame"),
    ),
    "solution": (
        (_RESIDUAL, "residual_m", "number", "distance of what the model reaches from the target"),
        (_ITERATIONS, "iterations", "integer", "steps of the solver"),
        (_LIMITED_BY, "limited_by", "integer", "bits; events 'limit_name' say what they stand for"),
    ),
    "command": ((_TIP_ERROR, "tip_error_m", "number", "distance of the commanded model's tip"),),
    "sample": (
        (_MEASURED_TIP, "measured_tip_m", "array", "where a tracker saw the tip, world frame"),
        (_MEASURED_DIRECTION, "measured_direction", "array", "unit tangent it saw there, world frame"),
        (_MEASURED_AGE, "measured_age_s", "number", "since that was captured"),
    ),
}
_ACTUATION: Final = {
    "target": (TARGET, "actuation the target asked for"),
    "solution": (SOLUTION, "actuation the model answered"),
    "command": (COMMAND, "actuation commanded after the limits"),
}
_SAMPLE: Final = (
    (VALUE, "value_{unit}", "number", "what the device reported"),
    (TIME, "time_s", "number", "when it was measured, on the clock of deadline_s"),
    (VALID, "valid", "boolean", "the newest exchange read it"),
    (AGE, "age_s", "number", "its age at the end of that exchange"),
    (VELOCITY, "velocity_{unit}_s", "number", "velocity the device reported"),
    (EFFORT, "effort", "number", "current [A] of servos and motors, duty of regulators"),
    (TEMPERATURE, "temperature_c", "number", "temperature of the device"),
    (VOLTAGE, "voltage_v", "number", "supply of the device"),
)


#: Keys of events that plotting programs can use; which of them an event has depends on its kind, and some
#: kinds have more (what an order asks for, what a bus has done).
_EVENT_KEYS: Final = (
    ("event", "string", "its kind"),
    ("tick", "integer", "number of the tick it belongs to"),
    ("robot", "string", "name of the robot"),
    ("bus", "string", "name of the bus"),
    ("axis", "string", "ROBOT.AXIS"),
    ("mode", "string", "state: the new mode of the robot"),
    ("order", "string", "order: what was asked for"),
    ("message", "string", "for a person"),
    ("reason", "string", "why a stop began"),
    ("seconds", "number", "stopping: how long it takes"),
    ("name", "string", "of a fault, or of a limit"),
    ("bit", "integer", "limit_name: the bit of limited_by that stands for the limit"),
    ("tier", "string", "tier: how old the data of the bus are now"),
    ("before", "string", "tier: and were before"),
    ("age_s", "number", "age of a measurement"),
    ("ticks", "integer", "report: that were run; skipped: in a row"),
    ("total", "integer", "skipped: so far"),
    ("missed_ticks", "integer", "overrun: that are not in the file"),
    ("missed_events", "integer", "overrun: that are not in the file"),
)


def schema(layout: RecordLayout, device_units: Mapping[str, str], channel: str) -> dict[str, Any]:
    """JSON Schema of a channel: every key of its messages, and which of them are always there."""
    if channel == EVENT:
        keys = {name: {"type": kind, "description": message} for name, kind, message in _EVENT_KEYS}
        return {"type": "object", "title": f"contid.{EVENT}", "properties": keys, "required": ["event"]}
    root: dict[str, Any] = {"title": f"contid.{channel}", **_object()}
    for each in fields(layout, device_units, channel):
        at = root
        for key in each.path[:-1]:
            at = _add(at, key, _object(), required=True)
        about: dict[str, Any] = {"type": each.kind, "description": each.message}
        if each.kind == "array":
            about |= {"items": {"type": "number"}, "minItems": 3, "maxItems": 3}
        _add(at, each.path[-1], about, each.required)
    message = "paths of numbers that are infinite, a minus in front of negative ones; absent without any"
    _add(
        root, INFINITE, {"type": "array", "items": {"type": "string"}, "description": message}, required=False
    )
    return root


def _object() -> dict[str, Any]:
    return {"type": "object", "properties": {}, "required": [], "additionalProperties": False}


def _add(parent: dict[str, Any], key: str, about: dict[str, Any], required: bool) -> dict[str, Any]:
    """The schema of a key, which is added when it is new."""
    if required and key not in parent["required"]:
        parent["required"].append(key)
    known: dict[str, Any] = parent["properties"].setdefault(key, about)
    return known
