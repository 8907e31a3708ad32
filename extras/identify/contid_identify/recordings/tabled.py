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
from contid.kinematics.batch import forward_many
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import build_model
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

MEASURED: Final = "meas."
#: Ticks are no longer than this, so that set-points keep their times [s].
_TICK_S: Final = 0.02
#: A value that repeats for longer is measured anew [s].
_REPEATS_S: Final = 0.1
#: Time in front of a recording that begins with a step [s]; of the range of a robot, a step.
_BEFORE_S: Final = 2.0
_STEP: Final = 0.05
#: Single tips are wrong that are farther from the median of five than this many times what this share of all
#: is at most, and this share of their extent.
_JUMP: Final = 5.0
_USUAL: Final = 0.95
_LEAST_JUMP: Final = 0.01
#: Set-points this far outside of the limits of a robot, in shares of its range, have another unit.
_BEYOND: Final = 0.5
#: Tips this many lengths of the arm from its base have another unit or frame.
_FARTHEST: Final = 2.0


@dataclass(frozen=True, eq=False)
class TabledRecording:
    """A recording, and what was decided or left out on the way, one sentence each."""

    recording: RobotRecording
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _MeantRows:
    """Rows of a table whose columns have a meaning; ``rows`` is NaN where a cell is lost."""

    table: Table
    mapping: Mapping
    names: tuple[str, ...]
    times_s: Array
    rows: Array

    def column(self, name: str) -> Array | None:
        """One column, None where the mapping has none."""
        return self.rows[:, self.names.index(name)] if name in self.names else None

    def at(self, row: int, name: str, message: str) -> BadInputError:
        """A finding at the row, and at the line of the mapping that gives the column."""
        line = self.mapping.lines.get(name)
        found = [Located(self.mapping.file, line, 1, f"{name} is this one")] if line else []
        return BadInputError([self.table.at(row, None, message), *found])


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
    found = _MeantRows(table.chosen(keep), mapping, values.names, times[keep], values.rows[keep])
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
    rest = turn @ _tip_at_rest(robot) + np.array(frame.origin_in_world)
    placed = read_frame(mapping, values, times, MM_PER_M * rest, MEASURED)
    notes.append(f"frame: {placed.shown}")
    return replace(values, rows=place(placed, values))


def _recording(
    file: str, name: str, robot: RobotDescription, of: _MeantRows, notes: list[str]
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
    _check_limits(of, robot, sent, first)
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
    if (jumps := _jumps(points[fresh])).any():
        row = int(of.table.lines[first + fresh[int(np.argmax(jumps))]])
        notes.append(f"{int(jumps.sum())} single tips jump and were left out, the first in line {row}")
        fresh = fresh[~jumps]
    points = points[fresh] / MM_PER_M
    if before is None and (early := _early(at_s, sent, at_s[fresh], points)):
        notes.append(early)
    frame = BaseFrame.of(robot.base)
    points = (points - np.array(frame.origin_in_world)) @ np.array(frame.rotation).reshape(3, 3)
    _check_tips(of, robot, points, fresh + first)
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


def _early(at_s: Array, sent: Array, tip_at_s: Array, tips: Array) -> str:
    """A warning where the tip moves before the first set-point that changes; "" where it does not."""
    first_s = at_s[int(np.argmax((sent != sent[0]).any(axis=1)))]
    own = tips[tip_at_s <= first_s]
    moved_m = float(np.ptp(own, axis=0).max()) if len(own) else 0.0
    if moved_m < _STEP * np.ptp(tips, axis=0).max():
        return ""
    return (
        f"the tip moves by {MM_PER_M * moved_m:.3g} mm before the first set-point changes ({first_s:.3g} s): "
        "it begins in motion, and models begin at rest; begin recordings with a rest, or give measured axes "
        "(`meas.`)"
    )


def _tip_at_rest(robot: RobotDescription) -> Array:
    """The tip ``(3,)`` [m] in the base frame."""
    own = np.asarray(forward_many(build_model(robot), np.array([robot.rest]))["tip_m"])[0]
    return np.append(own, np.zeros(3 - len(own)))


def _held(of: _MeantRows, name: str) -> Array:
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


def _jumps(points: Array) -> NDArray[np.bool_]:
    """Which tips ``(n, 3)`` are far from the median of five about them, as single wrong frames are."""
    if len(points) < 5:
        return np.zeros(len(points), dtype=bool)
    padded = np.pad(points, ((2, 2), (0, 0)), mode="edge")
    middle = np.median(np.stack([padded[k : k + len(points)] for k in range(5)]), axis=0)
    apart = np.linalg.norm(points - middle, axis=1)
    usual = float(np.quantile(apart, _USUAL))
    return np.asarray(apart > _JUMP * usual + _LEAST_JUMP * float(np.ptp(points, axis=0).max()))


def _check_limits(of: _MeantRows, robot: RobotDescription, sent: Array, first: int) -> None:
    """Refuse set-points that no such robot has."""
    for k, name in enumerate(robot.columns[: len(robot.axis_names)]):
        low, high = (robot.quantity.from_si(each[k]) for each in (robot.lower, robot.upper))
        beyond = _BEYOND * (high - low)
        out = (sent[:, k] < low - beyond) | (sent[:, k] > high + beyond)
        if out.any():
            row = int(np.argmax(out))
            raise of.at(
                row + first, name,
                f"{name} is {sent[row, k]:.4g}, but the limits of the robot are {low:.4g} to {high:.4g}: is "
                "its unit right, and are these limits those of the robot that was recorded?",
            )  # fmt: skip


def _check_tips(of: _MeantRows, robot: RobotDescription, tips: Array, rows: NDArray[np.intp]) -> None:
    """Refuse tips that no such robot reaches, or that stand still."""
    if not len(tips):
        return
    longest = float(np.linalg.norm(_tip_at_rest(robot)))
    far = np.linalg.norm(tips, axis=1) > _FARTHEST * longest
    if far.mean() > 0.5:
        row = int(np.argmax(far))
        off_mm = MM_PER_M * float(np.linalg.norm(tips[row]))
        raise of.at(
            int(rows[row]), f"{MEASURED}x_mm",
            f"the tip is {off_mm:.4g} mm from the base, but the robot is "
            f"{MM_PER_M * longest:.4g} mm long at rest: is its unit right? In the table of a camera the base "
            "stands elsewhere: take its place off, or write `frame: {origin: rest, at: rest}`",
        )  # fmt: skip
    if not np.ptp(tips, axis=0).any():
        raise ContidError(f"{of.table.file}: the measured tip never moves; are meas.x_mm .. its columns?")
