"""The three steps in a row: read, mean, place, and then the check of the robot."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Final, NamedTuple, TextIO, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from contid.errors import BadInputError, ContidError, Located
from contid_adapt.meaning.clock import check_order, pick_session, times_of
from contid_adapt.meaning.expression import evaluate, names_in
from contid_adapt.meaning.mapping import Mapping, read_mapping
from contid_adapt.meaning.smooth import held_rows, smooth
from contid_adapt.meaning.values import check_finite, check_time_units, nothing_moves, values_of
from contid_adapt.placing.frame import place, read_frame
from contid_adapt.reading.read import read_table
from contid_adapt.reading.table import Table

Floats: TypeAlias = NDArray[np.float64]

#: Digits of a written number behind the point: nanometres, nanoseconds.
_DIGITS: Final = {"t_s": 9}
_USUAL_DIGITS: Final = 6
#: Rows that are written at a time.
_CHUNK: Final = 20_000
#: Findings of the check of the robot that are shown.
_SHOWN: Final = 4


@dataclass(frozen=True, slots=True)
class Adapted:
    """A trajectory made of a table.

    Attributes:
        names: of its columns, ``t_s`` first.
        rows: shape ``(n, columns)`` in the units of the names.
        lines: for each row, the line of the file that it comes from.
        notes: one sentence for everything that was decided or left out.
        file: the table.
        accepted: the verdict of the check of the robot, "" before it.
    """

    names: tuple[str, ...]
    rows: Floats
    lines: NDArray[np.int64]
    file: str
    notes: list[str] = field(default_factory=list)
    accepted: str = ""

    def write(self, stream: IO[str]) -> None:
        """Write the trajectory as CSV."""
        formats = [f"%.{_DIGITS.get(name, _USUAL_DIGITS)}f" for name in self.names]
        line = (",".join(formats) + "\n").__mod__
        stream.write(",".join(self.names) + "\n")
        for begin in range(0, len(self.rows), _CHUNK):
            columns = (column.tolist() for column in (self.rows[begin : begin + _CHUNK] + 0.0).T)
            stream.write("".join(map(line, zip(*columns, strict=True))))


def adapt(path: str | Path, robot_file: str, mapping_text: str, mapping_file: str = "mapping") -> Adapted:
    """A trajectory for a robot from the table of another program, checked as before a run.

    Args:
        path: the table.
        robot_file: path, or name of a shipped file.
        mapping_text: at most eight lines of YAML, see docs/your-data.md.
        mapping_file: its name in messages.

    Raises:
        ContidError: with line and column what is wrong, or that nothing moves, or that the robot cannot.
    """
    table = read_table(path)
    return check(mean(table, robot_file, mapping_text, mapping_file), robot_file)


def mean(table: Table, robot_file: str, mapping_text: str, mapping_file: str = "mapping") -> Adapted:
    """The trajectory of a table, placed, without the check of the robot.

    Raises:
        ContidError: see `adapt`.
    """
    known, prefix, rest, planar = _robot(robot_file)
    mapping = read_mapping(mapping_text, mapping_file, known)
    notes = [*table.notes]
    check_time_units(table, mapping)
    if mapping.rows is not None:
        table = rows_chosen(table, mapping, notes)
    table = pick_session(table, mapping)
    times = times_of(table, mapping, notes)
    values = values_of(table, mapping, prefix, notes)
    check_finite(values, table)
    found: NDArray[np.bool_] = np.all(np.isfinite(values.rows), axis=1, keepdims=True)[:, 0]
    if not found.all():
        notes.append(f"{int((~found).sum())} of {len(found)} rows are lost samples and were left out")
    table, times = table.chosen(found), times[found]
    values = values.chosen(found)
    keep = check_order(table, times, mapping, values.rows, notes)
    table, times = table.chosen(keep), times[keep]
    values = values.chosen(keep)
    if still := nothing_moves(values, mapping):
        raise ContidError(f"{table.file}: {still}")
    frame = read_frame(mapping, values, times, rest, prefix)
    notes.append(f"frame: {frame.shown}")
    rows, lines = place(frame, values), table.lines
    names = [*values.names]
    own = [at for at, name in enumerate(names) if name in known and not (planar and name == "z_mm")]
    for name in (name for at, name in enumerate(names) if at not in own):
        span = np.ptp(rows[:, names.index(name)])
        notes.append(f"the robot has no {name}: left out, though it changes by {span:.3g}")
    if len(own) < len(names):
        names, rows = [names[at] for at in own], rows[:, own]
    notes.append(_extent(names, times, rows))
    times, rows, lines = _smoothed(names, times, rows, lines, mapping, notes)
    return Adapted(("t_s", *names), np.column_stack([times, rows]), lines, table.file, notes)


def check(adapted: Adapted, robot_file: str) -> Adapted:
    """The same trajectory after the check that `contid check ROBOT TRAJECTORY` makes.

    Raises:
        ContidError: the robot cannot follow; findings have lines of the table.
    """
    with TemporaryFile("w+", encoding="utf-8") as written:
        return check_written(adapted, robot_file, written)


def check_written(adapted: Adapted, robot_file: str, stream: IO[str]) -> Adapted:
    """`check`, which leaves the trajectory in an empty file: a long one is in memory once, as numbers.

    Raises:
        ContidError: see `check`.
    """
    from contid.control.daemon.check_trajectory import check_trajectory

    adapted.write(stream)
    stream.seek(0)
    try:
        accepted = check_trajectory(robot_file, adapted.file, cast("TextIO", stream))
    except BadInputError as error:
        raise BadInputError(
            _with_remedy([_at_table(each, adapted) for each in _shortened([*error.findings])], adapted)
        ) from error
    return replace(adapted, accepted=str(accepted))


def _extent(names: list[str], times: Floats, rows: Floats) -> str:
    """Size and pace of a path, which show a wrong unit at a glance."""
    spans = [
        f"{name} {low:.5g} to {high:.5g}"
        for name, low, high in zip(names, rows.min(0), rows.max(0), strict=True)
    ]
    usual = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    pace = f"{len(times)} rows, {usual:.4g} s apart, {times[-1] - times[0]:.5g} s in all"
    return f"path: {pace}; {', '.join(spans[:9])}"


def _at_table(found: Located, adapted: Adapted) -> Located:
    def line(number: int) -> int:
        row = number - 2
        return int(adapted.lines[row]) if 0 <= row < len(adapted.lines) else number

    message = re.sub(r"(?<= on line )\d+", lambda each: str(line(int(each[0]))), found.message)
    return Located(found.file, line(found.line), 1, message)


def _with_remedy(findings: list[Located], adapted: Adapted) -> list[Located]:
    """Findings of a path that is too fast begin with how it can be smoothed, where it was not."""
    if not any("slow down" in each.message for each in findings) or any(
        "smoothed" in note for note in adapted.notes
    ):
        return findings
    held = any("held" in note for note in adapted.notes)
    why = "samples are held for several rows" if held else "noise of a tracker is fast"
    message = f"too fast; {why}: `smooth_mm: 0.5` in the mapping smooths within 0.5 mm"
    return [Located(findings[0].file, findings[0].line, 1, message), *findings]


def _shortened(findings: list[Located]) -> list[Located]:
    """The first findings and the last, which counts: the same cause repeats in every row."""
    return findings if len(findings) <= _SHOWN else [*findings[: _SHOWN - 1], findings[-1]]


def rows_chosen(table: Table, mapping: Mapping, notes: list[str]) -> Table:
    """The rows of the condition of a mapping.

    Raises:
        BadInputError: no condition, or no row has it.
    """
    assert mapping.rows is not None
    keep = evaluate(mapping.rows.node, table)
    if keep.dtype != np.bool_:
        raise mapping.wrong(
            "rows", f"rows is a condition, such as `{(names_in(mapping.rows.node) or ['id'])[0]} == 1`"
        )
    if not keep.any():
        raise mapping.wrong("rows", f"no row has {mapping.rows.text}")
    notes.append(f"{int(keep.sum())} of {len(keep)} rows have {mapping.rows.text}")
    return table.chosen(keep)


def _smoothed(
    names: list[str],
    times: Floats,
    rows: Floats,
    lines: NDArray[np.int64],
    mapping: Mapping,
    notes: list[str],
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    keep, held = held_rows(rows)
    within = mapping.numbers.get("smooth_mm")
    if held > 1:
        what = f"samples are held for {held} rows ({int((~keep).sum())} of {len(rows)} repeat the one before)"
        notes.append(f"{what}: {'left out' if within else '`smooth_mm:` leaves them out'}")
    if within is None or len(rows) < 5:
        return times, rows, lines
    times, rows, lines = times[keep], rows[keep], lines[keep]
    groups: dict[str, list[int]] = {}
    for at, name in enumerate(names):
        if name.endswith(("x_mm", "y_mm", "z_mm")):
            groups.setdefault(name[:-4], []).append(at)
    found = smooth(times, rows, list(groups.values()), within)
    if found.width_s == 0.0:
        notes.append(f"nothing to be smoothed within {within:g} mm")
        return times, rows, lines
    notes.append(
        f"smoothed over {found.width_s * 1e3:.3g} ms: points moved by {found.rms:.3g} mm rms, "
        f"{found.greatest:.3g} mm at most (allowed {within:g} mm)"
    )
    return found.times, found.rows, lines[found.nearest]


class _Known(NamedTuple):
    """The columns of the robots of a file; prefix, tip at rest [mm] and plane of one that takes tips."""

    names: list[str]
    prefix: str
    rest_mm: Floats | None
    planar: bool


def _robot(robot_file: str) -> _Known:
    from contid import Robot
    from contid.robot_file.load import load_named
    from contid.trajectory.columns import vocabulary

    loaded = load_named(robot_file)
    robots = loaded.driven
    alone = len(loaded.file.robots) == 1
    names = [own if alone else f"{name}.{own}" for name, robot in robots.items() for own in vocabulary(robot)]
    takers = [name for name, robot in robots.items() if "tip" in robot.accepts]
    # A planar robot takes no z, but the table may need it to be turned.
    planar = bool(alone and takers and robots[takers[0]].dimension == 2)
    names += ["z_mm"] * planar
    if not takers:
        return _Known(names, "", None, False)
    first = Robot(robot_file) if alone else Robot(robot_file)[takers[0]]
    rest = np.zeros(3)
    tip = np.asarray(first.fk(first.limits.rest)["tip"]).reshape(-1)
    rest[: len(tip)] = tip
    return _Known(names, "" if alone else f"{takers[0]}.", rest, planar)
