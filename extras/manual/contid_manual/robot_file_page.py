"""The page about the robot file, generated from its schema: ``contid schema --markdown``.

It holds contid's own drivers only, so that it does not depend on installed packages.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from contid.hal import BUILT_IN
from contid.robot_file.base import AxisDescription
from contid_manual.schema import Schema, robot_file_schema

_EXAMPLE: Final = """\
contid: 1
name: my-finger
rate_hz: 200

buses:
  servos: {driver: dynamixel, port: /dev/serial/by-id/usb-FTDI_..., tolerance_ticks: 10}

robots:
  finger:
    model: rack_finger
    geometry:
      rack_spacing_mm: 15
      tip_length_mm: 25
      link: {length_mm: 6, width_mm: 13, gap_mm: 5}
    limits:
      length_mm: [20, 110]
    rates: {velocity_mm_s: 60, acceleration_mm_s2: 1000, jerk_mm_s3: 20000}
    axes:
      left:  # both are pushed against their stop, 18 mm of rack, by `contid home`
        {bus: servos, id: 1, mm_per_rev: 37.7, homing: {method: hard_stop, direction: -1, at_mm: 18}}
      right:  # mounted the other way round
        {bus: servos, id: 2, mm_per_rev: 37.7, direction: -1,
         homing: {method: hard_stop, direction: 1, at_mm: 18}}
"""
_INTRODUCTION: Final = """\
# The robot file

<!-- Made by `contid schema --markdown` from the docstrings of contid/robot_file and of the drivers. -->

One YAML file describes everything from geometry to wire. `contid check FILE` validates it and lists every
mistake, as `file:line:column: what; allowed; nearest name`; `contid schema` prints the JSON Schema
for editors. A complete file; `contid run FILE --mock` runs it without hardware:

```yaml
{EXAMPLE}```

* A key carries its unit (`_mm`, `_bar`, `_deg`, `_hz`). Unknown keys are refused.
* Scalars follow YAML 1.2: `1e-3` is a number, `on` is text. Tags are refused; an anchored value (`&name`)
  may be repeated (`*name`).
* Names of robots and buses are letters, digits, `_` and `-`, beginning with a letter. A robot's name stands
  in front of its trajectory columns.
* `placeholder` lists keys whose values are not measured yet, such as `geometry.tip_length_mm`;
  `contid check` and `contid run` report them.
* Lengths on servos and motors need `mm_per_rev`, lengths on regulators need `mm_to_bar`, pressures go to
  regulators as they are.
* The stop policy `vent` needs a robot with a regulator; `relax` needs a device with torque. This applies
  to the defaults too.
* The rest pose (`rest_mm` or `rest_bar`) lies inside the limits; without one it is the middle of the range
  for lengths and the minimum for pressures.

"""


def robot_file_page() -> str:
    """The whole page."""
    schema = robot_file_schema(BUILT_IN, models=())
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
    return _INTRODUCTION.replace("{EXAMPLE}", _EXAMPLE) + text.rstrip("\n") + "\n"


def _robots(schema: Schema) -> list[Schema]:
    robots: Schema = schema["properties"]["robots"]["additionalProperties"]
    return list(robots.get("oneOf", [robots]))


def _only(definition: Schema, keys: set[str]) -> Schema:
    """An object with only these keys."""
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
    if default is None or default == "" or isinstance(default, dict):
        return ""
    return f"`{str(default).lower() if isinstance(default, bool) else default}`"


def _allowed(value: Schema, definitions: dict[str, Schema]) -> str:
    """Allowed values, in brief."""
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        if definitions[name].get("type") != "object" and name not in ("BusDescription", "AxisDescription"):
            return _allowed(definitions[name], definitions)
        links = {"BusDescription": ("a bus", "buses"), "AxisDescription": ("an axis", "axes")}
        if "model" in definitions[name].get("properties", {}):
            model = definitions[name]["properties"]["model"]["const"]
            links[name] = (f"model {model}", f"model-{model}")
        text, anchor = links.get(name, (name, name.lower()))
        return f"[{text}](#{anchor})"
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
        count = _range(value.get("minItems"), value.get("maxItems"))
        return f"list of {count}{' ' * bool(count)}{_allowed(value.get('items', {}), definitions)}"
    if kind == "object" and isinstance(value.get("additionalProperties"), dict):
        return f"names with {_allowed(value['additionalProperties'], definitions)}"
    text = {"string": "text", "boolean": "`true`, `false`"}.get(kind, kind)
    return " ".join([text, *_bounds(value)])


def _bounds(value: Schema) -> Iterator[str]:
    """Allowed numbers: ``1 to 5``, ``> 0, <= 20``."""
    low, high = value.get("minimum"), value.get("maximum")
    if low is not None and high is not None:
        yield f"{low:g} to {high:g}"
    else:
        bounds = {
            ">": value.get("exclusiveMinimum"),
            ">=": low,
            "<": value.get("exclusiveMaximum"),
            "<=": high,
        }
        limits = [f"{sign} {bound:g}" for sign, bound in bounds.items() if bound is not None]
        if limits:
            yield ", ".join(limits)
    if "multipleOf" in value:
        yield f"in steps of {value['multipleOf']:g}"


def _range(low: int | None, high: int | None) -> str:
    """Allowed count of items, "" for any."""
    if high is None:
        return "" if low is None or low < 2 else f"{low} or more"
    return f"{high}" if low == high else f"{low or 0} to {high}"
