"""``contid schema``: every reference resolves, every driver is in it, and its page is current."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from jsonschema import Draft202012Validator

from contid.hal import BUILT_IN
from contid.robot_file.load import parse_robot_file
from contid.robot_file.loader import robot_classes
from contid.robot_file.positions import read_document
from contid_manual.schema import robot_file_schema
from contid_manual.schema_command import command as schema_command

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.fixture(scope="module")
def validator() -> Draft202012Validator:
    return Draft202012Validator(robot_file_schema())


def references(schema: Any) -> Iterator[str]:
    if isinstance(schema, dict):
        if isinstance(schema.get("$ref"), str):
            yield schema["$ref"]
        for value in schema.values():
            yield from references(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from references(value)


def test_the_schema_is_whole() -> None:
    schema = json.loads(CliRunner().invoke(schema_command, []).stdout)
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    names = {reference.removeprefix("#/$defs/") for reference in references(schema)}
    assert names <= set(schema["$defs"])
    drivers = {bus["properties"]["driver"]["const"] for bus in schema["$defs"]["BusDescription"]["oneOf"]}
    assert drivers >= set(BUILT_IN)
    models = {
        each["properties"]["model"]["const"]
        for each in schema["$defs"].values()
        if "model" in each.get("properties", {}) and "const" in each["properties"]["model"]
    }
    assert models == set(robot_classes())


def test_every_key_has_a_description() -> None:
    schema = robot_file_schema(BUILT_IN)
    objects = {"the file": schema, **schema["$defs"]}
    for kind in ("BusDescription", "AxisDescription"):
        choices = schema["$defs"][kind]
        objects |= {each["title"]: each for each in choices.get("oneOf", choices.get("anyOf"))}
    mute = [
        f"{name}: {key}"
        for name, definition in objects.items()
        for key, value in definition.get("properties", {}).items()
        if not value.get("description")
    ]
    assert not mute


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_an_editor_finds_nothing_wrong_in_a_shipped_robot_file(
    path: Path, validator: Draft202012Validator
) -> None:
    assert [error.message for error in validator.iter_errors(read_document(path.read_text(), "x").data)] == []


def test_an_editor_finds_what_is_wrong(validator: Draft202012Validator) -> None:
    data: Any = read_document((CONFIGS / "finger.yaml").read_text(), "x").data
    finger = data["robots"]["finger"]
    for broken in (
        {**data, "rate_hz": -1},
        {**data, "colour": "blue"},
        {**data, "robots": {"finger": {**finger, "model": "fingr"}}},
        {
            **data,
            "robots": {"finger": {**finger, "geometry": {**finger["geometry"], "tip_length_mm": "long"}}},
        },
        {**data, "buses": {"servos": {**data["buses"]["servos"], "baud": 1234}}},
    ):
        assert not validator.is_valid(broken)


def test_the_whole_robot_file_on_the_page_is_one() -> None:
    page = (CONFIGS.parent / "docs" / "robot-file.md").read_text()
    block = page.partition("```yaml\n")[2].partition("```")[0]
    assert list(parse_robot_file(block, "page").file.robots) == ["finger"]


def test_the_page_about_the_robot_file_is_current() -> None:
    page = CONFIGS.parent / "docs" / "robot-file.md"
    made = CliRunner().invoke(schema_command, ["--markdown"]).stdout
    assert page.read_text() == made, "run: contid schema --markdown > docs/robot-file.md"
