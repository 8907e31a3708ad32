"""Events keep every value through JSON; other keys or types become an `UnknownEvent`."""

from __future__ import annotations

import json
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from contid.control.engine.events.buses import UnknownEvent
from contid.control.engine.events.json_form import KEYS, KINDS, from_json, to_json
from contid.control.engine.events.robots import OrderGiven, OrderRefused
from contid.control.engine.tick_layout import RecordLayout
from contid.session.format.channels import EVENT, schema

SAMPLES: dict[str, Any] = {
    "string": "text",
    "integer": 7,
    "number": 0.1,
    "boolean": True,
    "array": [[0, "READY"]],
    "object": {"order": "hold", "robots": None},
}
SCHEMA = Draft202012Validator(schema(RecordLayout("none", 1.0, ()), {}, EVENT))


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_survives_json_and_matches_the_schema(kind: str) -> None:
    event = KINDS[kind](**{name: SAMPLES[key.json] for name, key in KEYS[kind].items()})
    text = json.dumps(to_json(event))
    assert from_json(json.loads(text)) == event
    assert json.loads(text)["event"] == kind
    SCHEMA.validate(json.loads(text))


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != OrderGiven.KIND])
def test_a_missing_or_wrong_value_is_not_taken_for_the_kind(kind: str) -> None:
    whole = {"event": kind} | {name: SAMPLES[key.json] for name, key in KEYS[kind].items()}
    for name, key in KEYS[kind].items():
        wrong = "x" if key.json in ("integer", "number", "boolean") else 5
        damaged = [{**whole, name: wrong}]
        if key.required:
            damaged.append({each: value for each, value in whole.items() if each != name})
        for data in damaged:
            event = from_json(data)
            assert isinstance(event, UnknownEvent)
            assert to_json(event) == data


def test_true_is_no_number() -> None:
    data = {"event": "skipped", "ticks": True, "total": 1}
    assert isinstance(from_json(data), UnknownEvent)


def test_keys_of_a_later_version_are_ignored_and_its_kinds_kept() -> None:
    data = {"event": "refused", "robot": "one", "message": "no", "later": 1}
    assert from_json(data) == OrderRefused(robot="one", message="no")
    assert from_json({"event": "later", "x": 1}) == UnknownEvent(kind="later", values={"x": 1})
