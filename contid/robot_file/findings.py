"""Pydantic's errors as located findings: what is wrong, what is allowed, the nearest name.

Keys that have another name today are refused in files, with that name, and accepted in recordings.
"""

from __future__ import annotations

import difflib
import functools
import json
from collections.abc import Iterable, Iterator
from typing import Any, Final, TypeAlias, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from contid.errors import MAX_FINDINGS, BadInputError, Located, first_findings
from contid.robot_file.gravity import remedy_for_gravity, with_down
from contid.robot_file.positions import Data, Document, KeyPath, step_into

Schema: TypeAlias = dict[str, Any]
_Kind = TypeVar("_Kind", bound=BaseModel)

#: Allowed names that a message lists, and among which it looks for the nearest.
MAX_NAMES: Final = 50
#: Of a wrong name that are compared with them.
MAX_CHARACTERS: Final = 80


def allowed_names(names: Iterable[str], wrong: str = "") -> str:
    """End of a message: the allowed names, and the nearest to the written one."""
    names = list(dict.fromkeys(names))
    listed = names[:MAX_NAMES]
    near = difflib.get_close_matches(wrong[:MAX_CHARACTERS], listed, n=1, cutoff=0.5)
    others = f" and {len(names) - MAX_NAMES} others" if len(names) > MAX_NAMES else ""
    # The same name with another type, such as '1' for 1, is no help.
    hint = f"; did you mean {near[0]!r}?" if near and near[0] != wrong else ""
    return f"allowed: {', '.join(listed) or 'none'}{others}{hint}"


def validated(document: Document, kind: type[_Kind]) -> _Kind:
    """A whole document as an object of a class.

    Raises:
        BadInputError: with every finding.
    """
    if not isinstance(document.data, dict):
        message = f"the file is no mapping of keys to values; {allowed_names(kind.model_fields)}"
        raise BadInputError([document.at_value((), message)])
    try:
        return kind.model_validate(document.data)
    except ValidationError as error:
        raise BadInputError(first_findings(explain(error, document, (), kind))) from None


def explain(
    error: ValidationError, document: Document, at: KeyPath, kind: type[BaseModel], also: Iterable[str] = ()
) -> list[Located]:
    """Every finding of one failed validation.

    Args:
        error: what pydantic raised for the data at ``at``.
        document: where positions come from.
        at: path of that data in the document.
        kind: the class that refused it; its schema gives the allowed values.
        also: further keys allowed at the top of the data.
    """
    schema = _schema(kind)
    # A union reports the same place once per alternative; one finding is enough.
    found: dict[Located, None] = {}
    for detail in error.errors(include_url=False):
        if detail["type"] == "too_short" and detail["ctx"]["actual_length"] < len(detail["input"]):
            continue  # pydantic leaves out items that it refuses, each with a finding of its own
        found[_finding(detail, document, at, schema, also)] = None
        if len(found) > MAX_FINDINGS:
            break
    return list(found)


@functools.cache
def _schema(kind: type[BaseModel]) -> Schema:
    """The schema of a class; pydantic takes milliseconds for one."""
    return kind.model_json_schema()


def _finding(
    detail: ErrorDetails, document: Document, at: KeyPath, schema: Schema, also: Iterable[str]
) -> Located:
    kind, context = detail["type"], detail.get("ctx", {})
    path = _written_path(document, at, detail["loc"])
    inside = path[len(at) :]
    name = _name(path)
    written = document.get(path)
    if kind == "extra_forbidden":
        parents = _places(schema, schema, inside[:-1])
        names = [key for parent in parents for key in parent.get("properties", ())]
        names += also if len(inside) == 1 else ()
        if (now := RENAMED_KEYS.get(name)) in names:
            return document.at_key(path, f"key {name!r} was renamed; write {now!r}")
        if (remedy := remedy_for_gravity(document.get(path[:2]), path[2:])) is not None:
            return document.at_key(path, remedy)
        return document.at_key(path, f"unknown key {name!r}; {allowed_names(names, name)}")
    if kind == "missing" and isinstance(path[-1], int):
        return document.at_value(path[:-1], f"{name} is missing")
    if kind == "missing":
        return document.at_key(path, f"key {name!r} is missing")
    if kind in ("enum", "literal_error"):
        here = _places(schema, schema, inside)
        values = [str(value) for each in here for value in each.get("enum", [each.get("const")])]
        message = f"{name}: {shown(written)} is not possible; {allowed_names(values, str(written))}"
    elif kind == "value_error":
        message = f"{name}: {context.get('error', detail['msg'])}"
        path = _key_in_message(document, path, str(context.get("error", "")))
    else:
        message = f"{name}: {_allowed_value(kind, context, detail['msg'])}, not {shown(written)}"
    return document.at_value(path, message)


def _name(path: KeyPath) -> str:
    """Name of a path in messages: its key, with the numbers of row and item inside a list."""
    match path:
        case (*_, str(key)):
            return key
        case (*_, str(key), int(item)):
            return f"{key}: item {item + 1}"
        case (*_, str(key), int(row), int(item)):
            return f"{key}: row {row + 1}, item {item + 1}"
    return "the file"


def _key_in_message(document: Document, path: KeyPath, message: str) -> KeyPath:
    """Path of the written key below ``path`` that a message begins with, such as ``limits.pull_mm has``."""
    for key in message.partition(" ")[0].rstrip(":").split("."):
        step = int(key) if key.isdecimal() else key
        if not step_into(document.get(path), step):
            break
        path = (*path, step)
    return path


def _allowed_value(kind: str, context: dict[str, Any], message: str) -> str:
    """The allowed values behind an error of pydantic."""
    numbers = {
        "greater_than": ("gt", "greater than"),
        "greater_than_equal": ("ge", "at least"),
        "less_than": ("lt", "less than"),
        "less_than_equal": ("le", "at most"),
    }
    if kind in numbers:
        key, relation = numbers[kind]
        return f"allowed is a number {relation} {context[key]:g}"
    expected = {
        "float_type": "allowed is a number",
        "finite_number": "allowed is a finite number",
        "int_type": "allowed is a whole number",
        "int_from_float": "allowed is a whole number",
        "bool_type": "allowed is true or false",
        "string_type": "allowed is a text",
        "model_type": "allowed is a mapping of keys to values",
        "dict_type": "allowed is a mapping of names to entries",
        "tuple_type": "allowed is a list in brackets",
        "list_type": "allowed is a list in brackets",
    }
    if kind in expected:
        return expected[kind]
    if kind == "string_pattern_mismatch":
        return f"allowed is a text that matches {context['pattern']}"
    if kind in ("too_long", "too_short"):
        limit = context.get("max_length", context.get("min_length"))
        return f"allowed is {'at most' if kind == 'too_long' else 'at least'} {limit} items"
    return message[:1].lower() + message[1:]


def shown(value: Data) -> str:
    """A value as it would be written, shortened."""
    text = json.dumps(value) if not isinstance(value, str) else repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _written_path(document: Document, at: KeyPath, location: tuple[str | int, ...]) -> KeyPath:
    """The path in the document of a pydantic location, without the tags of unions."""
    path = at
    for index, step in enumerate(location):
        if step_into(document.get(path), step) or index == len(location) - 1:
            path = (*path, step)
    return path


def _places(schema: Schema, root: Schema, path: KeyPath) -> Iterator[Schema]:
    """Every alternative of the schema at ``path``."""
    if "$ref" in schema:
        yield from _places(root["$defs"][schema["$ref"].rpartition("/")[2]], root, path)
        return
    alternatives = [each for key in ("anyOf", "oneOf", "allOf") for each in schema.get(key, ())]
    for alternative in alternatives:
        yield from _places(alternative, root, path)
    if not path:
        if not alternatives:
            yield schema
        return
    step, rest = path[0], path[1:]
    if isinstance(step, int):
        items = schema.get("prefixItems", [])
        below = items[step] if step < len(items) else schema.get("items")
    else:
        below = schema.get("properties", {}).get(step, schema.get("additionalProperties"))
    if isinstance(below, dict):
        yield from _places(below, root, rest)


#: Old key of an axis -> today's.
RENAMED_KEYS: Final = {"dead_man": "on_watchdog", "safe_state": "on_watchdog"}


def with_renamed_keys(data: Any) -> Any:
    """The data of a recorded robot file with today's keys, also where ``placeholder`` lists them."""
    robots = data.get("robots") if isinstance(data, dict) else None
    if not isinstance(robots, dict):
        return data
    return {**data, "robots": {name: _robot(robot) for name, robot in robots.items()}}


def _robot(robot: Any) -> Any:
    if not isinstance(robot, dict):
        return robot
    renamed = dict(with_down(robot))
    if isinstance(axes := robot.get("axes"), dict):
        renamed["axes"] = {name: _axis(axis) for name, axis in axes.items()}
    if isinstance(listed := robot.get("placeholder"), list):
        renamed["placeholder"] = [_dotted(key) if isinstance(key, str) else key for key in listed]
    return renamed


def _axis(axis: Any) -> Any:
    return {RENAMED_KEYS.get(k, k): v for k, v in axis.items()} if isinstance(axis, dict) else axis


def _dotted(key: str) -> str:
    parent, dot, last = key.rpartition(".")
    if key in ("geometry.gravity", "rod.gravity"):
        return "down"
    return f"{parent}{dot}{RENAMED_KEYS.get(last, last)}" if parent.startswith("axes.") else key
