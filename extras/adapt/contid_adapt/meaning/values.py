"""The quantities of a mapping, row by row, each checked against the units and names of its columns."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.errors import BadInputError, ContidError, Located
from contid_adapt.meaning.expression import affine, evaluate, names_in
from contid_adapt.meaning.mapping import Mapping, MappingLine
from contid_adapt.meaning.units import UNITS, factor_to
from contid_adapt.reading.table import Table

Floats: TypeAlias = NDArray[np.float64]

#: Norms of quaternions that are rounded, not wrong.
_NORM: Final = 0.02
#: Trackers of NDI write -3.7e28 for a lost sample.
_ABSURD: Final = 1e20
_UNIT: Final = re.compile(r"_(mm|cm|m)$")
_POINT: Final = re.compile(r"^(.*?)([xyz])_mm$")
#: Directions and loads, which move no robot by themselves.
_NO_MOTION: Final = re.compile(r"(?:^|\.)(?:[ab][xyz]|f[xyz]_n)$")


@dataclass(frozen=True, slots=True)
class Values:
    """Quantities of the columns of a trajectory.

    Attributes:
        names: of the columns, directions last.
        rows: shape ``(n, columns)``, NaN where lost; positions in mm.
        mirrored: the signs of the mapping turn a right hand into a left one.
    """

    names: tuple[str, ...]
    rows: Floats
    mirrored: bool = False

    def chosen(self, keep: NDArray[np.bool_]) -> Values:
        """The same quantities of some rows; itself with all."""
        if keep.all():
            return self
        return replace(self, rows=self.rows[keep])


def values_of(table: Table, mapping: Mapping, prefix: str, notes: list[str]) -> Values:
    """Evaluate a mapping.

    Args:
        table: rows of one session.
        mapping: parsed.
        prefix: of the columns of the robot that takes the direction of the quaternion.
        notes: what was noticed is added.

    Raises:
        BadInputError: contradicting units, wrong quaternions, unknown columns.
    """
    if not mapping.columns:
        raise mapping.wrong("x_mm", "no column of the robot; write `x_mm:`, `y_mm:` .. or those of its axes")
    parts = []
    for name, line in mapping.columns.items():
        _check_units(table, mapping, line)
        values = evaluate(line.node, table)
        if values.dtype.kind != "f":
            raise _at_line(mapping, line, f"{name}: a condition is no number")
        values[np.abs(values) > _ABSURD] = np.nan
        parts.append(values)
    names = list(mapping.columns)
    rows = np.column_stack(parts)
    _check_axes(table, mapping, rows)
    _lost_as_zeros(names, rows, notes)
    if mapping.quaternion is not None:
        order, lines = mapping.quaternion
        rows = np.column_stack([rows, _direction(table, mapping, order, lines, notes)])
        names += [f"{prefix}a{axis}" for axis in "xyz"]
        if len({*names}) < len(names):
            raise mapping.wrong(f"quaternion_{order}", "a direction and a quaternion; one of them")
    return Values(tuple(names), rows, _is_mirrored(mapping))


def _check_units(table: Table, mapping: Mapping, line: MappingLine) -> None:
    form, unit = affine(line.node), line.name.rpartition("_")[2]
    used = [table.column(name) for name in names_in(line.node)]
    for column in used:
        factor = factor_to(column.unit, unit)
        own = form.factors.get(column.name, form.factors.get(column.alias)) if form else None
        own = own if own is not None or not form else form.factors.get(f"c{column.position}")
        if column.unit == "s" and unit != "s":
            raise _at_line(mapping, line, f"{line.name}: {column.name!r} is a time [{column.unit}]")
        if factor is None or own is None or len(used) > 3:
            continue
        if abs(abs(own) / factor - 1.0) > 2e-3:
            what = f"{line.name}: {column.name!r} is in {column.unit} ({factor:.6g} {unit} each)"
            remedy = "to shrink or grow a path write `scale` in the frame"
            raise _at_line(mapping, line, f"{what}, but the mapping has {abs(own):.6g}; {remedy}")


def _check_axes(table: Table, mapping: Mapping, rows: Floats) -> None:
    """Refuse a column that stands for two axes of a point, and one of another name that does not change."""
    seen: dict[tuple[str, int, str], str] = {}
    lettered = {
        each for line in mapping.columns.values() for used in names_in(line.node) if (each := letter_of(used))
    }
    for place, (name, line) in enumerate(mapping.columns.items()):
        found, form = _POINT.match(name), affine(line.node)
        if not found or not form or len(form.factors) != 1:
            continue
        (used,) = form.factors
        column = table.column(used)
        own = found[1], column.position, column.name
        if other := seen.get(own):
            raise _at_line(mapping, line, f"{name}: {column.name!r} is {other} already")
        seen[own] = name
        if lettered and np.ptp(rows[:, place]) == 0.0 and not letter_of(column.name):
            remedy = f"for a path in a plane write `{name}: {rows[0, place]:g}`"
            raise _at_line(
                mapping, line, f"{name}: {column.name!r} never changes; is it the right column? {remedy}"
            )


def check_time_units(table: Table, mapping: Mapping) -> None:
    """Refuse a time whose factor contradicts the unit of its column."""
    if mapping.time is None:
        return
    form = affine(mapping.time.node)
    for name, own in (form.factors if form else {}).items():
        column = table.column(name)
        factor = factor_to(column.unit, "s")
        if column.unit and factor is None and column.unit in UNITS:
            raise mapping.wrong("t_s", f"{name!r} is in {column.unit}, no time")
        if own <= 0.0:
            raise mapping.wrong("t_s", f"{name!r} is multiplied by {own:g}: time would run back")
        if factor is not None and abs(own / factor - 1.0) > 2e-3:
            raise mapping.wrong("t_s", f"{name!r} is in {column.unit}: its factor is {factor:g}, not {own:g}")


def _at_line(mapping: Mapping, line: MappingLine, message: str) -> BadInputError:
    return BadInputError([Located(mapping.file, line.line, 1, message)])


def _lost_as_zeros(names: list[str], rows: Floats, notes: list[str]) -> None:
    """Rows whose three coordinates are exactly zero among others that never are: trackers write that."""
    groups: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        if found := _POINT.match(name):
            groups.setdefault(found[1], []).append(place)
    for places in groups.values():
        zero = np.all(rows[:, places] == 0.0, axis=1)
        others = np.linalg.norm(rows[~zero][:, places], axis=1)
        if not zero.any() or len(places) < 2 or not len(others):
            continue
        # A path may begin at zero: then its other points come as near as some of its steps are long.
        steps = np.linalg.norm(np.diff(rows[~zero][:, places], axis=0), axis=1)
        if np.nanmin(others) > max(1.0, 5.0 * float(np.nanmedian(steps)) if len(steps) else 0.0):
            rows[np.ix_(zero, places)] = np.nan
            notes.append(f"{int(zero.sum())} rows with a position of exactly zero count as lost")


def _direction(
    table: Table, mapping: Mapping, order: str, lines: tuple[MappingLine, ...], notes: list[str]
) -> Floats:
    key = f"quaternion_{order}"
    for letter, line in zip(order, lines, strict=True):
        for name in names_in(line.node):
            own = letter_of(table.column(name).name)
            if own and own != letter:
                what = f"{name!r} stands where {order} has {letter!r}"
                raise mapping.wrong(key, f"{what}: its name has {own!r}")
    parts = dict(zip(order, (evaluate(line.node, table) for line in lines), strict=True))
    w, x, y, z = (np.asarray(parts[letter], float) for letter in "wxyz")
    norm = np.sqrt(w * w + x * x + y * y + z * z)
    lost = ~np.isfinite(norm) | (norm == 0.0) | (norm > _ABSURD)
    wrong = np.flatnonzero(~lost & (np.abs(norm - 1.0) > _NORM))
    if len(wrong):
        column = table.column(names_in(lines[0].node)[0]) if names_in(lines[0].node) else None
        what = f"the quaternion has the norm {norm[wrong[0]]:.4g}, not 1 ({len(wrong)} rows)"
        raise BadInputError([table.at(int(wrong[0]), column, f"{what}; are these its columns?")])
    norm[lost] = np.nan
    w, x, y, z = w / norm, x / norm, y / norm, z / norm
    axes = {
        "x": (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        "y": (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        "z": (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    }
    sign = -1.0 if mapping.tool_axis.startswith("-") else 1.0
    notes.append(f"direction: the {mapping.tool_axis} axis of the body, quaternion in the order {order}")
    return sign * np.column_stack(axes[mapping.tool_axis.lstrip("-+")])


def letter_of(name: str) -> str:
    """The axis that a name ends with: ``qx``, ``orientation.w``, ``Rotation.Z``; "" for none."""
    name = _UNIT.sub("", name)
    found = re.search(r"(?:^|[^A-Za-z]|[a-z](?=[XYZW]$)|^[qptrQPTR])([wxyzWXYZ])\d*$", name)
    return found[1].lower() if found else ""


def _is_mirrored(mapping: Mapping) -> bool:
    """True where the signs that the mapping gives to axes named x, y, z turn a right hand into a left one."""
    for name in mapping.columns:
        found = _POINT.match(name)
        if not found or found[2] != "x":
            continue
        matrix = np.zeros((3, 3))
        for row, axis in enumerate("xyz"):
            line = mapping.columns.get(f"{found[1]}{axis}_mm")
            form = affine(line.node) if line else None
            for used, factor in (form.factors if form else {}).items():
                letter = letter_of(used)
                if letter in ("x", "y", "z"):
                    matrix[row, "xyz".index(letter)] += factor
        scale = np.abs(matrix).max()
        if f"{found[1]}z_mm" not in mapping.columns:
            matrix[2, 2] = scale
        if scale > 0.0 and np.linalg.det(matrix / scale) < -1e-6:
            return True
    return False


def nothing_moves(values: Values, mapping: Mapping) -> str:
    """Why nothing moves, "" where something does."""
    least = mapping.numbers.get("least_mm", 1.0)
    spans = np.ptp(values.rows, axis=0) if len(values.rows) else np.zeros(len(values.names))
    moving = [
        (name, span) for name, span in zip(values.names, spans, strict=True)
        if not _NO_MOTION.search(name) and "meas." not in name
    ]  # fmt: skip
    greatest = max((span for _, span in moving), default=0.0)
    lengths = all(name.endswith("_mm") for name, _ in moving)
    if greatest > 0.0 and (greatest >= least or not lengths):
        return ""
    what = ", ".join(f"{name} by {span:.3g}" for name, span in moving[:6])
    return f"nothing moves: {what} mm in all; is the unit right? (`least_mm:` allows less than {least:g} mm)"


def check_finite(values: Values, table: Table) -> None:
    """Refuse a table whose samples are all lost."""
    if not np.isfinite(values.rows).all(axis=1).any():
        raise ContidError(f"{table.file}: every sample is lost")
