"""The mapping that a table of a known program would have, to be shown before it is taken."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from contid_adapt.meaning.clock import stated_rates
from contid_adapt.meaning.units import factor_to
from contid_adapt.meaning.values import letter_of
from contid_adapt.reading.table import Table, TableColumn

_FRAME: Final = "frame: {up: %s, origin: rest, at: rest}"
_TIMES: Final = (
    "time",
    "t",
    "t_s",
    "timestamp",
    "%time",
    "stamp",
    "time_s",
    "seconds",
    "timestamp_s",
    "topt[0]",
)


@dataclass(frozen=True, slots=True)
class Proposal:
    """A proposed mapping.

    Attributes:
        program: what the table seems to come from, "" for unknown.
        text: YAML; lines that are unknown are comments.
        missing: what the table does not state, "" for nothing.
    """

    program: str
    text: str
    missing: str = ""

    def report(self, table: Table) -> str:
        """Columns and mapping, for the terminal."""
        lines = [f"{table.file}: {len(table)} rows" + (f", {self.program}" if self.program else "")]
        lines += [f"# {note}" for note in table.notes]
        for each in table.columns[:80]:
            unit = f" [{each.unit}]" if each.unit else ""
            lines.append(f"#   c{each.position}: {each.alias or '(no name)'}{unit} = {_shown(each)}")
        lines.append(
            f"# still needed: {self.missing}" if self.missing else "# take it with --map auto, or save it:"
        )
        return "\n".join([*lines, self.text.rstrip()])


def propose(table: Table, robot_file: str) -> Proposal:
    """The mapping that fits what the names of a table state; nothing is guessed from numbers."""
    program = _program(table)
    lines, missing = [], []
    time = _time(table, program)
    if time:
        lines.append(time)
    else:
        lines.append("# rate_hz: ?")
        missing.append("rate_hz, rows per second" + _stated_rate(table))
    points = _points(table) or _points(table, "xy")
    unit = {"QTM": "mm", "NDI": "mm", "opencr-mujoco": "mm"}.get(program, "")
    own = points[-1 if program == "trunk-stack" else 0] if points else []
    if own:
        units = [column.unit or unit for column in own]
        if not all(units):
            units = [
                "m" if program in ("EuRoC", "rostopic -p", "Motive", "trunk-stack") else each
                for each in units
            ]
        if not all(units):
            missing.append(f"the unit of {own[0].alias}: write its factor to mm")
        factors = [factor_to(each, "mm") if each else None for each in units]
        parts = [_times(factor, column, table) for factor, column in zip(factors, own, strict=True)]
        names = ", ".join(f"{axis}_mm" for axis in "xyz"[: len(parts)])
        lines.append(f"{names}: [{', '.join(parts)}]")
        if len(points) > 1:
            others = ", ".join(each[0].alias for each in points[:6] if each is not own)
            lines.append(f"# other bodies begin with: {others}")
    else:
        lines.append("# x_mm, y_mm, z_mm: [?, ?, ?]")
        missing.append("the columns of the position, or of the axes of the robot")
    turn = _quaternion(table, own)
    if turn and _takes_direction(robot_file):
        lines.append(turn)
    lines.append(_FRAME % ("y" if program == "Motive" or program == "trunk-stack" else "z"))
    return Proposal(program, "\n".join(lines) + "\n", "; ".join(missing))


def _program(table: Table) -> str:
    names = {each.name for each in table.columns}
    joined = " ".join(names)
    if "Format Version" in table.facts:
        return "Motive"
    if {"MARKER_NAMES", "BODY_NAMES", "NO_OF_BODIES"} & table.facts.keys():
        return "QTM"
    if "p_RS_R_x" in names:
        return "EuRoC"
    if any(name.startswith("field.") for name in names):
        return "rostopic -p"
    if "observation.state" in joined or ("frame_index" in names and "episode_index" in names):
        return "LeRobot"
    if "topt[0]" in names or {"x1", "y1", "z1", "x3", "y3", "z3"} <= names:
        return "trunk-stack"
    if {"pattern_label", "tip_x"} <= names:
        return "opencr-mujoco"
    if "Tools" in names and "Q0" in names:
        return "NDI"
    return ""


def _time(table: Table, program: str) -> str:
    """The line of the time: of a column that is called so, or the only one with a unit of time."""
    numbers = [each for each in table.columns if not each.is_text]
    stated = [each for each in numbers if factor_to(each.unit, "s")]
    first = ("field.header.stamp",) if program == "rostopic -p" else ()
    called = [
        each
        for name in (*first, *_TIMES)
        for each in numbers
        if name.strip("%").lower() in (each.alias.lower(), each.alias.lower().rpartition(".")[2])
    ]
    called += [each for each in stated if re.search("time|stamp|^t_", each.name, re.IGNORECASE)]
    called += stated if len(stated) == 1 else []
    if not called:
        return ""
    column = called[0]
    whole = 1e-9 if column.values.dtype.kind == "i" else 1.0
    return f"t_s: {_times(factor_to(column.unit, 's') if column.unit else whole, column, table)}"


def _stated_rate(table: Table) -> str:
    return next((f" (the file states {key} {value:g})" for key, value in stated_rates(table)), "")


def _points(table: Table, axes: str = "xyz") -> list[list[TableColumn]]:
    """Columns side by side that are called x, y, z at their ends; positions before anything else."""
    found = []
    for start in range(len(table.columns) - len(axes) + 1):
        beside = list(table.columns[start : start + len(axes)])
        letters = [letter_of(re.sub(r"_(mm|m|cm)$", "", each.name)) for each in beside]
        if letters == [*axes] and not any(each.is_text for each in beside):
            found.append(beside)
    wrong = re.compile(r"rot|orient|quat|^q|[^a-z]q|vel|acc|ang|twist|force|torque|^[vab]_", re.IGNORECASE)
    first = re.compile(r"pos|^p|^t[xyz]$|tip|^T[xyz]$", re.IGNORECASE)
    found = [each for each in found if not wrong.search(each[0].name)]
    return sorted(found, key=lambda each: not first.search(each[0].name))


def _quaternion(table: Table, point: list[TableColumn]) -> str:
    """The quaternion whose names state their order, of the body of a position."""
    body = point[0].name.rpartition("osition")[0][:-1] if point else ""
    columns = [
        each
        for each in table.columns
        if not each.is_text
        and each.name.startswith(body)
        and all(each is not own for own in point)
        and not each.unit
    ]
    for four in zip(columns, columns[1:], columns[2:], columns[3:], strict=False):
        letters = "".join(letter_of(each.name) for each in four)
        if letters in ("wxyz", "xyzw"):
            return f"quaternion_{letters}: [{', '.join(_times(1.0, each, table) for each in four)}, z]"
        if [each.name for each in four] == ["Q0", "Qx", "Qy", "Qz"]:
            return "quaternion_wxyz: [Q0, Qx, Qy, Qz, z]"
    return ""


def _takes_direction(robot_file: str) -> bool:
    from contid.robot_file.load import load_named

    return any("direction" in robot.accepts for robot in load_named(robot_file).driven.values())


def _times(factor: float | None, column: TableColumn, table: Table) -> str:
    twice = sum(each.alias == column.alias for each in table.columns) > 1
    plain = re.fullmatch(r"[A-Za-z_][\w.]*(\[\d+\](\.[A-Za-z_]\w*)*)*", column.alias)
    name = f"c{column.position}" if twice or not plain else column.alias
    return name if factor == 1.0 else f"{factor:g}*{name}" if factor else f"?*{name}"


def _shown(column: TableColumn) -> str:
    values = column.values[:3]
    if column.is_text:
        return ", ".join(str(each)[:20] for each in values) + " .."
    return ", ".join(f"{each:.10g}" if values.dtype.kind == "f" else str(each) for each in values) + " .."
