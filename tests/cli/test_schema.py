"""``contid schema``: every reference resolves, every driver is in it, and its page is current."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from click.testing import CliRunner

from contid.cli.schema import command
from contid.description.load import robot_classes
from contid.hal import BUILT_IN


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
    schema = json.loads(CliRunner().invoke(command, []).stdout)
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


def test_the_page_about_the_robot_file_is_current() -> None:
    page = Path(__file__).parent.parent.parent / "docs" / "robot-file.md"
    made = CliRunner().invoke(command, ["--markdown"]).stdout
    assert page.read_text() == made, "run: contid schema --markdown > docs/robot-file.md"
