"""A mapping: at most eight lines of YAML that state which columns of a table mean what."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import yaml

from contid.errors import BadInputError, ContidError, Located
from contid_adapt.meaning.expression import ExpressionNode, parse

MAX_LINES: Final = 8
#: Keys that are no columns of the robot: name, and what stands behind it.
KEYS: Final = {
    "t_s": "time [s], an expression",
    "rate_hz": "rows per second, for a table without a clock",
    "quaternion_wxyz": "four expressions, and the axis of the body that is the tip's direction",
    "quaternion_xyzw": "the same, the real part last",
    "frame": "where the table lies in the world of the robot",
    "rows": "a condition: which rows",
    "session": "which of several sessions, from 1",
    "smooth_mm": "greatest distance by which smoothing may move a point",
    "gap_s": "longest time without a sample",
    "least_mm": "motion below which nothing moves (1)",
}


@dataclass(frozen=True, slots=True)
class MappingLine:
    """One expression of a mapping and where it stands."""

    name: str
    text: str
    node: ExpressionNode
    line: int


@dataclass(slots=True)
class Mapping:
    """A mapping, parsed.

    Attributes:
        file: its name in messages.
        columns: of the trajectory.
        quaternion: order and four expressions, None for none.
        tool_axis: axis of the body that is the tip's direction: "z", "-y".
        frame: as written: a word or keys with values; None for none.
        numbers: the keys with one number.
        lines: key -> line in the file.
    """

    file: str
    time: MappingLine | None = None
    columns: dict[str, MappingLine] = field(default_factory=dict)
    quaternion: tuple[str, tuple[MappingLine, ...]] | None = None
    tool_axis: str = "z"
    frame: Any = None
    rows: MappingLine | None = None
    numbers: dict[str, float] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)

    def wrong(self, key: str, message: str) -> BadInputError:
        """A finding at the line of a key."""
        return BadInputError([Located(self.file, self.lines.get(key, 1), 1, message)])


def read_mapping(text: str, file: str, robot_columns: Sequence[str]) -> Mapping:
    """Parse a mapping.

    Args:
        text: YAML.
        file: its name in messages.
        robot_columns: names of the robot, see `contid check ROBOT`.

    Raises:
        BadInputError: more than eight lines, no YAML, unknown keys, or no expressions.
    """
    lines = [
        line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(("#", "---"))
    ]
    if len(lines) > MAX_LINES:
        raise BadInputError([Located(file, 1, 1, f"{len(lines)} lines; a mapping has at most {MAX_LINES}")])
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        message = f"not YAML: {getattr(error, 'problem', error)}"
        raise BadInputError([Located(file, line, column, message)]) from error
    if not isinstance(root, yaml.MappingNode):
        raise BadInputError([Located(file, 1, 1, "a mapping has lines like `x_mm: 1000*x`")])
    mapping = Mapping(file)
    for key_node, value_node in root.value:
        key, line = str(key_node.value), key_node.start_mark.line + 1
        if key in mapping.lines:
            raise BadInputError([Located(file, line, 1, f"{key!r} stands twice")])
        mapping.lines[key] = line
        try:
            _take(mapping, key, plain(value_node), line, robot_columns)
        except BadInputError:
            raise
        except ContidError as error:
            raise BadInputError(
                [Located(file, line, value_node.start_mark.column + 1, str(error))]
            ) from error
    return mapping


def plain(node: Any, depth: int = 0) -> Any:
    """Texts, lists and dictionaries of a YAML node, nothing else: ``y`` stays a letter."""
    if depth > 5:
        raise ContidError("nested too deeply")
    if isinstance(node, yaml.MappingNode):
        return {str(key.value): plain(value, depth + 1) for key, value in node.value}
    if isinstance(node, yaml.SequenceNode):
        return [plain(each, depth + 1) for each in node.value]
    return str(node.value)


def number_of(text: Any, what: str) -> float:
    """A finite number.

    Raises:
        ContidError: it is none.
    """
    try:
        value = float(text)
    except (TypeError, ValueError):
        value = math.nan
    if not math.isfinite(value):
        raise ContidError(f"{what}: {str(text)[:40]!r} is not a number")
    return value


def _take(mapping: Mapping, key: str, value: Any, line: int, robot_columns: Sequence[str]) -> None:
    if key == "t_s":
        mapping.time = _line(key, value, line)
    elif key == "rows":
        mapping.rows = _line(key, value, line)
    elif key == "frame":
        mapping.frame = value
    elif key.startswith("quaternion_") and key in KEYS:
        if not isinstance(value, list) or len(value) not in (4, 5):
            raise ContidError(f"{key} is a list of four expressions, and an axis such as z or -y")
        mapping.tool_axis = str(value[4]) if len(value) == 5 else "z"
        if mapping.tool_axis.lstrip("-+") not in ("x", "y", "z"):
            raise ContidError(f"the axis {mapping.tool_axis!r} is none of x, y, z, -x, -y, -z")
        if mapping.quaternion is not None:
            raise ContidError("a mapping has one quaternion")
        mapping.quaternion = key.removeprefix("quaternion_"), tuple(_line(key, v, line) for v in value[:4])
    elif key in KEYS:
        number = number_of(value, key)
        if number <= 0.0 and key != "least_mm":
            raise ContidError(f"{key} is greater than 0")
        mapping.numbers[key] = number
    else:
        names = [name.strip() for name in key.split(",")]
        values = value if isinstance(value, list) else [value]
        if len(names) != len(values):
            raise ContidError(f"{len(names)} columns, but {len(values)} expressions")
        for name, each in zip(names, values, strict=True):
            if name not in robot_columns:
                _unknown(name, robot_columns)
            if name in mapping.columns:
                raise ContidError(f"{name!r} stands twice")
            mapping.columns[name] = _line(name, each, line)


def _line(name: str, value: Any, line: int) -> MappingLine:
    if not isinstance(value, str) or not value.strip():
        raise ContidError(f"{name} is one expression, such as 1000*x")
    return MappingLine(name, value, parse(value), line)


def _unknown(name: str, robot_columns: Sequence[str]) -> None:
    import difflib

    stem = name.rpartition("_")[0]
    near = [each for each in robot_columns if stem and each.rpartition("_")[0] == stem]
    near = near or difflib.get_close_matches(name, [*KEYS, *robot_columns], n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise ContidError(
        f"no column {name!r} of this robot; allowed: {', '.join([*KEYS, *robot_columns])}{hint}"
    )
