"""A table of another program as the recording of a robot: set-points, measured axes and tips.

A mapping of `contid adapt` names the columns: those of the axes (``s1.p1_bar``) are what was commanded, the
same behind ``meas.`` what was measured, ``meas.x_mm`` and so on the tip of a tracker. A set-point holds until
the next row that has one; a measurement that repeats exactly counts once in `_REPEATS_S`, as loggers write
the last one until the next comes. Many tables begin with the first step itself, when the devices are still
where they were: then `_BEFORE_S` with what they measured stand in front, so that models begin at rest there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from contid.errors import BadInputError, ContidError, Located
from contid.kinematics.array import Array
from contid.kinematics.frames import BaseFrame
from contid.robot_file.robot import RobotDescription
from contid.units import MM_PER_M
from contid_adapt.adapt import rows_chosen
from contid_adapt.meaning.clock import check_order, pick_session, times_of
from contid_adapt.meaning.mapping import MAX_LINES, Mapping, read_mapping
from contid_adapt.meaning.values import Values, check_time_units, values_of
from contid_adapt.placing.frame import place, read_frame
from contid_adapt.reading.read import read_table
from contid_adapt.reading.table import Table
from contid_identify.recording import LEAST_TICKS, RobotRecording
from contid_identify.recordings.plausible import (
    MeantRows,
    check_limits,
    check_tips,
    jumping,
    moves_early,
    tip_at_rest,
)

MEASURED: Final = "meas."
#: Ticks are no longer than this, so that set-points keep their times [s].
_TICK_S: Final = 0.02
#: A value that repeats for longer is measured anew [s].
_REPEATS_S: Final = 0.1
#: Time in front of a recording that begins with a step [s]; of the range of a robot, a step.
_BEFORE_S: Final = 2.0
_STEP: Final = 0.05


@dataclass(frozen=True, eq=False)
class TabledRecording:
    """A recording, and what was decided or left out on the way, one sentence each."""

    recording: RobotRecording
    notes: tuple[str, ...]


def read_tabled(path: Path, name: str, robot: RobotDescription, text: str, file: str) -> TabledRecording:
    """A recording of one robot.

    Args:
        path: of the table, in any format that `contid adapt` reads.
        name: of the robot, in messages.
        robot: its description.
        text: mapping; "" where the table has the names of the robot, in its world frame.
        file: name of the mapping, in messages.

    Raises:
        BadInputError: with line and column, columns that are not there, units that cannot be, gaps.
        ContidError: too short, or no axis moves.
    """
    table = read_table(path)
    axes = robot.columns
    known = [*axes, *(MEASURED + each for each in axes), *(f"{MEASURED}{each}_mm" for each in "xyz")]
    mapping = read_mapping(text or _own_names(table, known), file or "its own names", known)
    for key in ("quaternion_wxyz", "quaternion_xyzw", "smooth_mm", "least_mm"):
        if key in mapping.lines:
            raise mapping.wrong(key, f"{key} is for trajectories; a recording has no use for it")
    if missing := [each for each in axes if each not in mapping.columns]:
        what = f"no set-points of {', '.join(missing)}; {table.named(missing[0])}"
        example = f"write `{missing[0]}: COLUMN`, times the factor of its unit, in a mapping (`--map FILE`)"
        raise mapping.wrong("t_s", f"{table.file}: {what}; {example}")
    notes = [*table.notes]
    check_time_units(table, mapping)
    if mapping.rows is not None:
        table = rows_chosen(table, mapping, notes)
    table = pick_session(table, mapping)
    times = times_of(table, mapping, notes)
    values = _placed(values_of(table, mapping, "", notes), times, robot, mapping, notes)
    keep = check_order(table, times, mapping, values.rows, notes)
    found = MeantRows(table.chosen(keep), mapping, values.names, times[keep], values.rows[keep])
    return _recording(path.name, name, robot, found, notes)


def _own_names(table: Table, known: list[str]) -> str:
    """The mapping of a table that has the names of the robot."""
    own = {each.name for each in table.columns}
    used = [each for each in known if each in own]
    time = "t_s" if "t_s" in own else ""
    if not used or not time:
        raise BadInputError(
            [
                Located(
                    table.file, max(table.names_line, 1), 1,
                    f"no column {'t_s' if used else known[0]!r}: the table is one of another program; "
                    f"{table.named(known[0])}. State what they mean in a mapping of at most {MAX_LINES} "
                    "lines, `--map FILE` (docs/robots/identify.md)",
                )
            ]
        )  # fmt: skip
    listed = ", ".join(used)
    return (
        f"t_s: t_s\n'{listed}': [{', '.join(f'`{each}`' for each in used)}]\nframe: robot\n".replace(
            "[`", '["`'
        )
        .replace("`, `", '`", "`')
        .replace("`]", '`"]')
    )


def _placed(
    values: Values, times: Array, robot: RobotDescription, mapping: Mapping, notes: list[str]
) -> Values:
    """With tips in the world of the robot."""
    if f"{MEASURED}x_mm" not in values.names:
        notes.append("no measured tip (`meas.x_mm`): only the axes are identified")
        return values
    frame = BaseFrame.of(robot.base)
    turn = np.array(frame.rotation).reshape(3, 3)
    rest = turn @ tip_at_rest(robot) + np.array(frame.origin_in_world)
    placed = read_frame(mapping, values, times, MM_PER_M * rest, MEASURED)
    notes.append(f"frame: {placed.shown}")
    return replace(values, rows=place(placed, values))


def _recording(
    file: str, name: str, robot: RobotDescription, of: MeantRows, notes: list[str]
) -> TabledRecording:
    """On equal ticks, in SI units and the base frame."""
    sent = np.column_stack([_held(of, axis) for axis in robot.columns])
    begun = np.isfinite(sent).all(axis=1)
    if not begun.any():
        raise ContidError(f"{of.table.file}: no row has set-points of all axes")
    first = int(np.argmax(begun))
    if first:
        notes.append(f"{first} rows before the first set-points of all axes were left out")
    at_s = of.times_s[first:] - of.times_s[first]
    sent = sent[first:]
    check_limits(of, robot, sent, first)
    usual = float(np.median(np.diff(at_s))) if len(at_s) > 1 else 0.0
    if len(at_s) < LEAST_TICKS:
        raise ContidError(f"{of.table.file}: {len(at_s)} rows; at least {LEAST_TICKS} needed")
    if not np.ptp(sent, axis=0).any():
        raise ContidError(f"{of.table.file}: no set-point changes; nothing of its motion can be identified")
    period_s = usual / max(int(np.ceil(usual / _TICK_S - 1e-6)), 1)
    ticks = np.arange(0.0, at_s[-1] + 0.5 * period_s, period_s)
    rows = np.clip(np.searchsorted(at_s, ticks + 1e-9, side="right") - 1, 0, None)
    si = [quantity.to_si(1.0) for quantity in robot.quantities]
    measured = []
    for column, factor in zip(robot.columns, si, strict=True):
        values = of.column(MEASURED + column)
        fresh = np.zeros(0, dtype=int) if values is None else _fresh(at_s, values[first:, None])
        measured.append((at_s[fresh], np.zeros(0) if values is None else factor * values[first:][fresh]))
    out = sent[rows] * np.array(si)
    before = _before(out[0], measured, robot, notes)
    later = 0 if before is None else math.ceil(_BEFORE_S / period_s)
    if before is not None:
        out = np.vstack([np.tile(before, (later, 1)), out])
        measured = [(at + later * period_s, values) for at, values in measured]
    tips = [of.column(f"{MEASURED}{axis}_mm") for axis in "xyz"]
    points = np.column_stack([np.zeros(len(at_s)) if each is None else each[first:] for each in tips])
    fresh = _fresh(at_s, points) if tips[0] is not None else np.zeros(0, dtype=int)
    if lost := len(at_s) - int(np.isfinite(points).all(axis=1).sum()):
        notes.append(f"{lost} of {len(at_s)} rows have no tip")
    if (jumps := jumping(points[fresh])).any():
        row = int(of.table.lines[first + fresh[int(np.argmax(jumps))]])
        notes.append(f"{int(jumps.sum())} single tips jump and were left out, the first in line {row}")
        fresh = fresh[~jumps]
    points = points[fresh] / MM_PER_M
    if before is None and (early := moves_early(at_s, sent, at_s[fresh], points)):
        notes.append(early)
    frame = BaseFrame.of(robot.base)
    points = (points - np.array(frame.origin_in_world)) @ np.array(frame.rotation).reshape(3, 3)
    check_tips(of, robot, points, fresh + first)
    notes.append(
        f"{len(at_s)} rows, {usual:.4g} s apart, {at_s[-1]:.5g} s in all; {len(points)} measured tips"
        + (f", moving by {MM_PER_M * float(np.ptp(points, axis=0).max()):.4g} mm" if len(points) else "")
    )
    recording = RobotRecording(
        file, robot, robot.all_axis_names, period_s, out,
        tuple(at for at, _ in measured), tuple(each for _, each in measured),
        at_s[fresh] + later * period_s, points,
    )  # fmt: skip
    return TabledRecording(recording, tuple(notes))


def _before(
    sent: Array, measured: list[tuple[Array, Array]], robot: RobotDescription, notes: list[str]
) -> Array | None:
    """Where the devices stood before the first set-points ``(axes,)``; None where they stood at these.

    Without a measurement an axis stood at its first set-point.
    """
    out = sent.copy()
    for k, (at_s, values) in enumerate(measured[: len(robot.axis_names)]):
        if len(at_s) and at_s[0] <= _REPEATS_S:
            span = robot.upper[k] - robot.lower[k]
            out[k] = values[0] if abs(values[0] - sent[k]) > _STEP * span else sent[k]
    moved = [name for name, a, b in zip(robot.axis_names, out, sent, strict=False) if a != b]
    if not moved:
        return None
    notes.append(
        f"it begins with a step: {', '.join(moved)} measured otherwise than commanded; {_BEFORE_S:g} s of "
        "what was measured stand in front"
    )
    return out


def _held(of: MeantRows, name: str) -> Array:
    """Set-points of an axis, each held until the next."""
    values = of.column(name)
    assert values is not None
    places = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), -1))
    return np.asarray(np.where(places >= 0, values[np.maximum(places, 0)], np.nan))


def _fresh(at_s: Array, values: Array) -> NDArray[np.intp]:
    """Rows whose values are new: not lost, and not those of the last one within `_REPEATS_S`."""
    rows = np.flatnonzero(np.isfinite(values).all(axis=1))
    out: list[int] = []
    for row in rows.tolist():
        if out and at_s[row] - at_s[out[-1]] < _REPEATS_S and (values[row] == values[out[-1]]).all():
            continue
        out.append(row)
    return np.array(out, dtype=int)
