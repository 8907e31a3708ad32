"""Reading a whole trajectory: everything is checked before anything moves."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Final, TextIO

import numpy as np

from contid.errors import BadInputError, Located
from contid.robot_file.robot import RobotDescription
from contid.trajectory.columns import ColumnLayout
from contid.trajectory.lines import NO_TIMES, lines_from_header, numbered_lines
from contid.trajectory.rows import MAX_NUMBER, MAX_ROWS, RowReader
from contid.trajectory.spline import Floats
from contid.trajectory.timed import Interpolation, Trajectory
from contid.units import MAX_LINE

#: Lines that are read at once.
LINES: Final = 8192
#: Reading stops after this many findings; mistakes usually repeat in every row.
MAX_FINDINGS: Final = 50
#: Least time from row to row. No tick is as short, and a shorter time is a mistake of rounding or unit.
MIN_ROW_INTERVAL_S: Final = 1e-4
_ROUNDING: Final = 1.0 - 1e-3
#: Cosine of 150 degrees: directions of neighbouring rows further apart have no unique path between them.
_MIN_COSINE: Final = -0.866
#: Vectors without a component as large are made larger, by a power of two, which is exact.
_SMALL: Final = 1e-140
_LARGER: Final = 2.0**600


def read_trajectory(
    stream: TextIO,
    name: str,
    robots: Mapping[str, RobotDescription],
    interpolation: Interpolation = Interpolation.CUBIC,
) -> Trajectory:
    """Read CSV or NDJSON with times.

    Args:
        stream: the text; read to its end.
        name: of the source, for messages.
        robots: descriptions by name.
        interpolation: from row to row.

    Raises:
        BadInputError: every finding (at most `MAX_FINDINGS`), each with line and column.
    """
    return _read(lines_from_header(numbered_lines(stream)), name, robots, interpolation)


def trajectory_of_rows(reader: RowReader, rows: Iterable[Sequence[float]]) -> Trajectory:
    """The trajectory of rows of numbers in the units of their columns; the header counts as line 1.

    Args:
        reader: of a header with times.
        rows: as they came.

    Raises:
        BadInputError: see `read_trajectory`.
    """
    return _read(enumerate(rows, 2), reader.name, {}, Interpolation.CUBIC, reader)


def _read(
    numbered: Iterable[tuple[int, str | Sequence[float]]],
    name: str,
    robots: Mapping[str, RobotDescription],
    interpolation: Interpolation,
    reader: RowReader | None = None,
) -> Trajectory:
    findings: list[Located] = []
    values, lines = array("d"), array("q")
    readers = [] if reader is None else [reader]
    number = 0
    for number, given in _one_by_one(numbered, readers, values, lines):
        if reader is not None and isinstance(given, str) and not given.strip(", "):
            continue  # An empty row of a spreadsheet.
        try:
            if reader is None:
                assert isinstance(given, str), "rows of numbers come with a reader"
                reader = RowReader(given, name, robots, number)
                readers.append(reader)
                if not reader.timed:
                    raise BadInputError([Located(name, number, 1, NO_TIMES)])
                if not reader.is_json:
                    continue
            row = reader.row(given, number)
            assert reader.layout.time is not None
            time_s = row[reader.layout.time]
            last_time = values[reader.layout.time - len(row)] if values else -math.inf
            if time_s - last_time < MIN_ROW_INTERVAL_S * _ROUNDING:
                column = reader.column(given, reader.layout.time)
                message = f"{_time_fault(time_s, last_time)} on line {lines[-1]}"
                raise BadInputError([Located(name, number, column, message)])
        except BadInputError as error:
            findings += error.findings
            if reader is None or not reader.timed:
                break
            if len(findings) >= MAX_FINDINGS:
                findings = findings[:MAX_FINDINGS]
                findings.append(Located(name, number, 1, f"{MAX_FINDINGS} mistakes so far; not read further"))
                break
            continue
        values.extend(row)
        lines.append(number)
        if len(lines) > MAX_ROWS:
            findings.append(Located(name, number, 1, f"more than {MAX_ROWS} rows; split the trajectory"))
            break
    if reader is None and not findings:
        findings.append(Located(name, max(number, 1), 1, "empty: a header and at least one row are needed"))
    elif not findings and not lines:
        findings.append(Located(name, max(number, 1), 1, "no rows after the header"))
    if findings or reader is None:
        raise BadInputError(findings)
    rows = np.frombuffer(values, dtype=np.float64).reshape(len(lines), len(reader.layout.names))
    _check_directions(reader, rows, lines, name)
    rows.setflags(write=False)
    return Trajectory(reader.layout, rows, lines, interpolation)


def _one_by_one(
    numbered: Iterable[tuple[int, str | Sequence[float]]],
    readers: Sequence[RowReader],
    values: array[float],
    lines: array[int],
) -> Iterator[tuple[int, str | Sequence[float]]]:
    """The lines that have to be looked at one by one; blocks of plain ones are added to values and lines."""
    numbered = iter(numbered)
    for header in numbered:
        yield header
        if readers:
            break
    else:
        return
    given = readers[0]
    size, time, least_s = len(given.layout.names), given.layout.time, MIN_ROW_INTERVAL_S * _ROUNDING
    while block := list(islice(numbered, LINES)):
        rows = None
        texts = [line for _, line in block if isinstance(line, str)]
        if time is not None and texts and not given.is_json and len(lines) + len(texts) <= MAX_ROWS:
            rows = plain_rows(given.layout, texts, least_s)
        if rows is None or time is None or (values and rows[0, time] - values[time - size] < least_s):
            yield from block
        else:
            values.frombytes(rows.tobytes())
            lines.extend([number for number, _ in block])


def _time_fault(time_s: float, last_time: float) -> str:
    if time_s > last_time:
        allowed = f"rows are at least {MIN_ROW_INTERVAL_S:g} s apart"
        return (
            f"time {time_s!r} is too close; {allowed}: it is {time_s - last_time:.3g} s after {last_time!r}"
        )
    what = "repeats" if time_s == last_time else "runs backwards"
    return f"time {what}: {time_s!r} after {last_time!r}"


def _check_directions(reader: RowReader, rows: Floats, lines: array[int], name: str) -> None:
    """Normalise directions in place, and x axes across them; refuse turns by more than 150 degrees."""
    findings = []
    for columns in reader.layout.robots:
        if not columns.direction:
            continue
        along, beside = list(columns.direction), list(columns.x_axis)
        for index in (along, beside):  # squares of small numbers vanish
            small = np.abs(rows[:, index]).max(axis=1, initial=0.0, keepdims=True) < _SMALL
            rows[:, index] *= np.where(small, _LARGER, 1.0)
        rows[:, along] /= np.linalg.norm(rows[:, along], axis=1)[:, None]
        if beside:
            inner = np.einsum("ij,ij->i", rows[:, along], rows[:, beside])
            rows[:, beside] -= inner[:, None] * rows[:, along]
            rows[:, beside] /= np.linalg.norm(rows[:, beside], axis=1)[:, None]
        for index, called in ((along, "direction"), (beside, "x axis")):
            cosine = np.einsum("ij,ij->i", rows[1:, index], rows[:-1, index])
            for row in np.flatnonzero(cosine < _MIN_COSINE)[:MAX_FINDINGS] if index else ():
                turns = "turns by more than 150 degrees since line"
                what = f"the {called} of {columns.robot!r} {turns} {lines[row]}"
                findings.append(Located(name, lines[row + 1], 1, f"{what}; add rows between them"))
    if findings:
        raise BadInputError(findings)


def plain_rows(layout: ColumnLayout, lines: Sequence[str], least_s: float) -> Floats | None:
    """Rows ``(lines, columns)`` in SI of lines of a CSV, as `RowReader` reads single ones.

    None where one of them needs a closer look: where anything is wrong, for quotes, and for columns that a
    row replaces by others.

    Args:
        layout: of the columns, with a time.
        lines: without comments and blank lines.
        least_s: between two rows.
    """
    size = len(layout.names)
    if any(each.x_axis or each.arcs for each in layout.robots) or max(map(len, lines)) > MAX_LINE:
        return None
    try:
        values = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    if values.shape != (len(lines), size):
        return None
    rows: Floats = values * layout.factors / layout.divisors
    if not np.abs(values).max() <= MAX_NUMBER:  # NaN is not
        return None
    if not (np.diff(rows[:, layout.time]) >= least_s).all():
        return None
    if any(each.direction and not rows[:, each.direction].any(axis=1).all() for each in layout.robots):
        return None
    return rows
