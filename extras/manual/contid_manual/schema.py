"""The JSON Schema of a robot file (draft 2020-12), with the keys of every driver in it.

For completion and checks in editors. ``contid check`` also finds what a schema cannot express, such as a
missing axis or two axes with one id.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from inspect import cleandoc
from typing import Any, Final, TypeAlias

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from contid.hal import driver_names, load_driver
from contid.robot_file.base import AxisDescription
from contid.robot_file.document import BusDescription, RobotFile
from contid.robot_file.model_plugins import load_plugin, plugin_names
from contid.robot_file.robot import RobotDescription

Schema: TypeAlias = dict[str, Any]

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"


def robot_file_schema(drivers: Iterable[str] | None = None, models: Iterable[str] | None = None) -> Schema:
    """The schema of a whole robot file.

    Args:
        drivers: those whose keys to include; every installed one by default.
        models: those of other distributions to include; every installed one by default.
    """
    loaded = {name: load_driver(name) for name in (driver_names() if drivers is None else drivers)}
    kinds: list[type[BaseModel]] = [RobotFile, BusDescription, AxisDescription]
    for driver in loaded.values():
        kinds += [driver.bus_options, driver.axis_options]
    plugins = {name: load_plugin(name).description for name in (plugin_names() if models is None else models)}
    kinds += plugins.values()
    references, top = models_json_schema([(kind, "validation") for kind in dict.fromkeys(kinds)])
    definitions: dict[str, Schema] = top["$defs"]
    name_of: dict[object, str] = {
        kind: reference["$ref"].rpartition("/")[2] for (kind, _), reference in references.items()
    }
    _describe(definitions, _by_name(kinds) | {name_of[kind]: kind for kind in kinds})

    def joined(common: type[BaseModel], own: type[BaseModel], title: str) -> Schema:
        ours, theirs = definitions[name_of[common]], definitions[name_of[own]]
        return {
            "title": title,
            "description": theirs.get("description", ""),
            "type": "object",
            "properties": {**ours["properties"], **theirs.get("properties", {})},
            "required": [*ours.get("required", ()), *theirs.get("required", ())],
            "additionalProperties": False,
        }

    buses, axes = [], []
    for name, driver in loaded.items():
        bus = joined(BusDescription, driver.bus_options, f"bus with driver {name}")
        bus["properties"]["driver"] = {"const": name, "description": f"`{name}`."}
        buses.append(bus)
        axes.append(joined(AxisDescription, driver.axis_options, f"axis on a bus with driver {name}"))
    nothing: Schema = {"not": {}}  # without drivers there is no bus
    definitions[name_of[BusDescription]] = {"oneOf": buses} if buses else nothing
    # The driver of an axis is a key of its bus, which a schema cannot relate: any driver is allowed.
    definitions[name_of[AxisDescription]] = {"anyOf": axes} if axes else nothing
    for driver in loaded.values():
        for own in (driver.bus_options, driver.axis_options):
            definitions.pop(name_of[own], None)
    root = definitions.pop(name_of[RobotFile])
    robots: Schema = root["properties"]["robots"]["additionalProperties"]
    for name, plugin in plugins.items():
        reference = f"#/$defs/{name_of[plugin]}"
        robots["oneOf"].append({"$ref": reference})
        robots["discriminator"]["mapping"][name] = reference
    return {"$schema": DIALECT, **root, "title": "contid robot file", "$defs": definitions}


def meanings(kind: type[BaseModel]) -> dict[str, str]:
    """Meaning of each key, from the ``Attributes`` of a class and of its bases."""
    found: dict[str, str] = {}
    for each in reversed(kind.__mro__):
        _, _, section = cleandoc(each.__dict__.get("__doc__") or "").partition("Attributes:\n")
        names: list[str] = []
        for line in section.splitlines():
            text = line.strip()
            entry = re.match(r"([a-z][a-z0-9_]*(?:, [a-z][a-z0-9_]*)*): (.*)", text)
            indent = len(line) - len(line.lstrip())
            if entry and indent <= 4:
                names = entry[1].split(", ")
                found.update(dict.fromkeys(names, entry[2]))
            elif text and names:
                found.update({name: f"{found[name]} {text}" for name in names})
            else:
                names = []
    return found


def summary(kind: type[BaseModel]) -> str:
    """The docstring of a class up to its ``Attributes``, as one paragraph."""
    text = (kind.__doc__ or "").partition("Attributes:\n")[0]
    return " ".join(text.split())


def _by_name(kinds: Iterable[type[BaseModel]]) -> dict[str, type[BaseModel]]:
    """The given classes and those of their fields, by name."""
    found: dict[str, type[BaseModel]] = {}
    seen: set[type[BaseModel]] = set()
    waiting: list[Any] = list(kinds)
    while waiting:
        kind = waiting.pop()
        waiting += getattr(kind, "__args__", ())
        if isinstance(kind, type) and issubclass(kind, BaseModel) and kind not in seen:
            seen.add(kind)
            found[kind.__name__] = kind
            waiting += [field.annotation for field in kind.model_fields.values()]
    return found


def _describe(definitions: Mapping[str, Schema], kinds: Mapping[str, type[BaseModel]]) -> None:
    """Add the documented meaning of every key, and the summary of every object."""
    for name, definition in definitions.items():
        kind = kinds.get(name)
        if kind is None:
            continue
        definition["description"] = summary(kind)
        if issubclass(kind, RobotDescription):
            # The keys of the model first, then the common ones.
            keys = sorted(
                definition["properties"],
                key=lambda key: (key != "model", key in RobotDescription.model_fields),
            )
            definition["properties"] = {key: definition["properties"][key] for key in keys}
        for key, meaning in meanings(kind).items():
            if key in definition.get("properties", {}):
                definition["properties"][key]["description"] = meaning
