"""The page about the robot file, made from its schema: ``contid schema --markdown``.

Only contid's own drivers are on it, so that the page does not depend on what else is installed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from contid.description.base import AxisDescription
from contid.description.schema import Schema, robot_file_schema
from contid.hal import BUILT_IN

_INTRODUCTION: Final = """\
# The robot file

<!-- Made by `contid schema --markdown` from the docstrings of contid/description and of the drivers. -->

One YAML file describes everything from geometry to wire. `contid check FILE` validates it and names every
mistake at once, as `file:line:column: what; allowed; nearest name`; `contid schema` prints the JSON Schema
for editors.

* A key carries its unit (`_mm`, `_bar`, `_deg`, `_hz`). Unknown keys are refused.
* Scalars follow YAML 1.2: `1e-3` is a number, `on` is a word. Tags are refused; an anchored value (`&name`)
  may be repeated (`*name`).
* Names of robots and buses are letters, digits, `_` and `-`, beginning with a letter. A robot's name stands
  in front of its trajectory columns.
* `placeholder` lists keys whose numbers no one measured, such as `geometry.tip_length_mm`; `contid check` and
  `contid run` report them.
* Lengths on servos and motors need `mm_per_rev`, lengths on regulators need `mm_to_bar`, pressures go to
  regulators as they are.
* The stop policy `vent` needs a robot with a regulator; `relax` needs one with something else than
  regulators. That holds for the defaults too.
* The rest pose (`rest_mm` or `rest_bar`) lies inside the limits; without one it is the middle of the range
  for lengths and the lower end for pressures.

"""


def robot_file_page() -> str:
    """The whole page."""
    schema = robot_file_schema(BUILT_IN)
    definitions: dict[str, Schema] = schema["$defs"]
    lines = ["## Top level", "", *_table(schema, definitions)]
    lines += ["## Buses", ""]
    for bus in definitions["BusDescription"]["oneOf"]:
        lines += [f"### {bus['title'].capitalize()}", "", bus["description"], "", *_table(bus, definitions)]
    lines += ["## Axes", "", "The keys of an axis are these and those of the driver of its bus.", ""]
    axes = definitions["AxisDescription"]["anyOf"]
    common = set(AxisDescription.model_fields)
    lines += _table(_only(axes[0], common), definitions)
    for axis in axes:
        own = _only(axis, set(axis["properties"]) - common)
        lines += [f"### {axis['title'].capitalize()}", "", axis["description"], "", *_table(own, definitions)]
    lines += ["## Robots", ""]
    robots = [each["$ref"].rpartition("/")[2] for each in _robots(schema)]
    for name in robots:
        robot = definitions[name]
        model = robot["properties"]["model"]["const"]
        lines += [f"### Model {model}", "", robot.get("description", ""), "", *_table(robot, definitions)]
    lines += ["## Parts", ""]
    skipped = {"BusDescription", "AxisDescription", *robots}
    for name, definition in sorted(definitions.items()):
        if name not in skipped and definition.get("type") == "object":
            lines += [
                f"### {name}",
                "",
                definition.get("description", ""),
                "",
                *_table(definition, definitions),
            ]
    text = "\n".join(lines).replace("``", "`")
    while "\n\n\n" in text:
        text = text.replace("\n\n\n", "\n\n")
    return _INTRODUCTION + text.rstrip("\n") + "\n"


def _robots(schema: Schema) -> list[Schema]:
    robots: Schema = schema["properties"]["robots"]["additionalProperties"]
    return list(robots.get("oneOf", [robots]))


def _only(definition: Schema, keys: set[str]) -> Schema:
    """The same object with some of its keys."""
    return {**definition, "properties": {k: v for k, v in definition["properties"].items() if k in keys}}


def _table(definition: Schema, definitions: dict[str, Schema]) -> Iterator[str]:
    yield "| key | allowed | default | meaning |"
    yield "|---|---|---|---|"
    required = definition.get("required", ())
    for key, value in definition.get("properties", {}).items():
        default = "required" if key in required else _default(value)
        meaning = value.get("description", "").replace("|", "\\|")
        yield f"| `{key}` | {_allowed(value, definitions)} | {default} | {meaning} |"
    yield ""


def _default(value: Schema) -> str:
    default = value.get("default")
    if default is None or isinstance(default, dict):
        return ""
    return f"`{str(default).lower() if isinstance(default, bool) else default}`"


def _allowed(value: Schema, definitions: dict[str, Schema]) -> str:
    """What a value may be, in a few words."""
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        if definitions[name].get("type") != "object" and name not in ("BusDescription", "AxisDescription"):
            return _allowed(definitions[name], definitions)
        links = {"BusDescription": ("a bus", "buses"), "AxisDescription": ("an axis", "axes")}
        words, anchor = links.get(name, (name, name.lower()))
        return f"[{words}](#{anchor})"
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{each}`" for each in value["enum"])
    either: list[Schema] = [*value.get("anyOf", ()), *value.get("oneOf", ())]
    alternatives = [each for each in either if each.get("type") != "null"]
    if alternatives:
        return " or ".join(dict.fromkeys(_allowed(each, definitions) for each in alternatives))
    kind = str(value.get("type"))
    if kind == "array":
        if "prefixItems" in value:
            return f"[{', '.join(_allowed(each, definitions) for each in value['prefixItems'])}]"
        return f"list of {_allowed(value.get('items', {}), definitions)}"
    if kind == "object" and isinstance(value.get("additionalProperties"), dict):
        return f"names with {_allowed(value['additionalProperties'], definitions)}"
    return " ".join([{"string": "text", "boolean": "`true`, `false`"}.get(kind, kind), *_bounds(value)])


def _bounds(value: Schema) -> Iterator[str]:
    for key, sign in (
        ("exclusiveMinimum", ">"),
        ("minimum", ">="),
        ("exclusiveMaximum", "<"),
        ("maximum", "<="),
    ):
        if key in value:
            yield f"{sign} {value[key]:g}"
    if "multipleOf" in value:
        yield f"in steps of {value['multipleOf']:g}"
