"""Events as JSON objects and back; keys, types and meanings derive from the fields of their classes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Any, Final, get_args, get_origin, get_type_hints

from contid.control.engine.events import RunEvent, buses, robots, run
from contid.control.engine.events.buses import UnknownEvent
from contid.control.engine.events.robots import OrderGiven

_JSON: Final = {
    str: "string",
    int: "integer",
    float: "number",
    bool: "boolean",
    list: "array",
    dict: "object",
}


@dataclass(frozen=True, slots=True)
class EventKey:
    """A key of an event in JSON: its JSON type, its meaning, and whether every event of the kind has it."""

    json: str
    meaning: str
    required: bool


def _keys(kind: type[RunEvent]) -> dict[str, EventKey]:
    hints = get_type_hints(kind, include_extras=True)
    keys = {}
    for each in fields(kind):
        hint, meaning = get_args(hints[each.name])
        keys[each.name] = EventKey(_JSON[get_origin(hint) or hint], meaning, each.default is MISSING)
    return keys


#: Every kind of event by the value of ``event`` in its JSON.
KINDS: Final[Mapping[str, type[RunEvent]]] = {
    each.KIND: each
    for module in (run, robots, buses)
    for each in vars(module).values()
    if isinstance(each, type) and issubclass(each, RunEvent) and each.KIND
}
#: The keys of every kind.
KEYS: Final = {name: _keys(kind) for name, kind in KINDS.items()}


def to_json(event: RunEvent) -> dict[str, Any]:
    """The JSON object of an event."""
    match event:
        case OrderGiven(tick=tick, order=order):
            return {"event": event.KIND, "tick": tick, **order}
        case UnknownEvent(kind=kind, values=values):
            return {"event": kind, **values}
    return {"event": event.KIND, **{name: getattr(event, name) for name in KEYS[event.KIND]}}


def from_json(data: Mapping[str, Any]) -> RunEvent:
    """The event of a JSON object; `UnknownEvent` when it does not have the keys and types of its kind."""
    name = data["event"]
    values = {key: value for key, value in data.items() if key != "event"}
    if name == OrderGiven.KIND and "order" in values and _is(values.get("tick"), "integer"):
        return OrderGiven(tick=values.pop("tick"), order=values)
    keys = KEYS.get(name)
    if keys is None or not all(
        _is(values[name], key.json) if name in values else not key.required for name, key in keys.items()
    ):
        return UnknownEvent(kind=name, values=values)
    return KINDS[name](**{key: values[key] for key in keys if key in values})


def _is(value: object, json: str) -> bool:
    """True for a value of a JSON type."""
    if isinstance(value, bool):
        return json == "boolean"
    if json == "number":
        return isinstance(value, int | float)
    return any(isinstance(value, kind) for kind, name in _JSON.items() if name == json)
