"""The channels of a session: the JSON keys of every value of a record, and their JSON Schemas.

Each tick writes one message to each of `TICK_CHANNELS`, each event one to ``event``. Values are SI with the
unit in the key (``left_m``, ``p1_pa``, ``tip_m``); a dot in an axis name becomes an underscore, because
plotting programs split keys at dots. A number or vector that is NaN has no key; integers, booleans and
objects are always present. The values are declared in `contid.control.engine.tick_layout`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from contid.control.engine.events.json_form import KEYS, KINDS
from contid.control.engine.tick_layout import AXIS, HEAD, ROBOT, RecordLayout, Value

TICK_CHANNELS: Final = ("tick", "target", "solution", "command", "sample")
EVENT: Final = "event"
#: Not recorded, but computed from the others when a session is compacted: measured axes and tips.
MEASURED: Final = "measured"
#: Revision of the messages; readers accept every one. 1 adds the measured tip; 2 omits absent values
#: (before: ``null``) and lists infinite ones (before: ``1e999``); 3 renames keys of events
#: (`RENAMED_EVENT_KEYS`); 4 adds the tension at a load cell.
REVISION: Final = 4
CHANNELS: Final = (*TICK_CHANNELS, EVENT)
#: Key of the paths of infinite numbers, which JSON lacks; a minus precedes negative ones.
INFINITE: Final = "infinite"
#: Keys of events in revisions 0 to 2 -> their names from revision 3 on.
RENAMED_EVENT_KEYS: Final = {"words": "message", "told": "report"}
#: Unit in a robot file -> unit of SI.
SI: Final = {"mm": "m", "bar": "pa", "deg": "rad"}


@dataclass(frozen=True, slots=True)
class Field:
    """One value of a message.

    Attributes:
        path: keys from the message down to it.
        slots: places in the record; three make a vector.
        kind: JSON Schema type of it.
        meaning: description of it in the schema.
    """

    path: tuple[str, ...]
    slots: tuple[int, ...]
    kind: str
    meaning: str

    @property
    def required(self) -> bool:
        """It is in every message; others are left out while a record has NaN there."""
        return self.kind in ("integer", "boolean")


def key_of(axis: str) -> str:
    """An axis name as it stands in keys."""
    return axis.replace(".", "_")


def fields(layout: RecordLayout, device_units: Mapping[str, str], channel: str) -> Iterator[Field]:
    """Every value of a channel's messages, in order.

    Args:
        layout: layout of the records.
        device_units: ``rad`` or ``pa`` by ``ROBOT.AXIS``.
        channel: one of `TICK_CHANNELS`.
    """
    head = HEAD.values if channel == TICK_CHANNELS[0] else HEAD.values[:1]
    yield from (_field(value, value.place, (), value.name) for value in head)
    of_robot = [value for value in ROBOT.values if value.about.channel == channel]
    of_axis = [value for value in AXIS.values if value.about.channel == channel]
    for index, robot in enumerate(layout.robots):
        front = ("robots", robot.name)
        for value in of_robot:
            yield _field(value, layout.robot_place(index, value.name), front, value.name)
        for nested in (False, True):
            for number, axis in enumerate(robot.axes):
                device = device_units[f"{robot.name}.{axis}"]
                for value in of_axis:
                    path = value.about.path
                    if ("/" in path) == nested:
                        place = layout.axis_place(index, number, value.name)
                        path = path.format(axis=key_of(axis), unit=SI[robot.units[number]], device=device)
                        yield _field(value, place, front, path)


def _field(value: Value, place: int, front: tuple[str, ...], path: str) -> Field:
    slots = tuple(range(place, place + value.numbers))
    return Field((*front, *path.split("/")), slots, value.json, value.about.meaning)


def _event_schema() -> dict[str, Any]:
    """Schema of the events: every key with its types, its meanings and the kinds that have it."""
    properties: dict[str, Any] = {"event": {"type": "string", "description": f"kind: {', '.join(KINDS)}"}}
    for name in {name: None for keys in KEYS.values() for name in keys}:
        kinds = {kind: keys[name] for kind, keys in KEYS.items() if name in keys}
        types = list(dict.fromkeys(key.json for key in kinds.values()))
        if name == "order":  # its value is the name of the order
            types = ["string"]
        meanings: dict[str, list[str]] = {}
        for kind, key in kinds.items():
            meanings.setdefault(key.meaning, []).append(kind)
        text = "; ".join(
            f"{', '.join(kinds_with_it)}: {meaning}" for meaning, kinds_with_it in meanings.items()
        )
        properties[name] = {"type": types[0] if len(types) == 1 else types, "description": text}
    return {"type": "object", "title": f"contid.{EVENT}", "properties": properties, "required": ["event"]}


def schema(layout: RecordLayout, device_units: Mapping[str, str], channel: str) -> dict[str, Any]:
    """JSON Schema of a channel: every key of its messages, and which of them are always there."""
    if channel == EVENT:
        return _event_schema()
    root: dict[str, Any] = {"title": f"contid.{channel}", **empty_schema()}
    for field in fields(layout, device_units, channel):
        parent = root
        for key in field.path[:-1]:
            parent = add_key(parent, key, empty_schema(), required=True)
        about: dict[str, Any] = {"type": field.kind, "description": field.meaning}
        if field.kind == "array":
            about |= {"items": {"type": "number"}, "minItems": 3, "maxItems": 3}
        add_key(parent, field.path[-1], about, field.required)
    meaning = "paths of numbers that are infinite, a minus in front of negative ones; absent without any"
    add_key(
        root, INFINITE, {"type": "array", "items": {"type": "string"}, "description": meaning}, required=False
    )
    return root


def empty_schema() -> dict[str, Any]:
    """The schema of an object without keys."""
    return {"type": "object", "properties": {}, "required": [], "additionalProperties": False}


def add_key(parent: dict[str, Any], key: str, about: dict[str, Any], required: bool) -> dict[str, Any]:
    """The schema of a key, which is added when it is new."""
    if required and key not in parent["required"]:
        parent["required"].append(key)
    known: dict[str, Any] = parent["properties"].setdefault(key, about)
    return known
