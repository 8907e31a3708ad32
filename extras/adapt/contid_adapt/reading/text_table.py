"""A text to a table: dialect, header, rows."""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from contid.errors import BadInputError, Located
from contid_adapt.meaning.units import name_and_unit, unit_of_name
from contid_adapt.reading.cells import (
    EXACT,
    begins,
    is_list,
    is_lost,
    is_number,
    listed,
    number,
    numbers,
    split,
    unquoted,
)
from contid_adapt.reading.dialect import DIGITS, Dialect, find_dialect, is_comment
from contid_adapt.reading.header import TableHeader, read_header
from contid_adapt.reading.table import Table, TableColumn

#: Rows that are turned into numbers at a time.
_CHUNK: Final = 20_000
_MAX_FINDINGS: Final = 20
#: What Motive and QTM call the number of rows of a file.
_COUNTS: Final = ("Total Exported Frames", "NO_OF_FRAMES")


def read_text(lines: list[str], file: str, whole_end: bool = True) -> Table:
    """The table of the lines of a text.

    Args:
        lines: of the file.
        file: its name in messages.
        whole_end: the file ends with the end of a line.

    Raises:
        BadInputError: rows of other counts of cells, or no rows.
    """
    turned = _transposed(lines)
    if turned is not None:
        return turned(file)
    dialect = find_dialect(lines, file)
    header = read_header(lines, dialect, file)
    if not header.line and not any(header.names) and _counts_up(lines, dialect):
        header.names = [cell.strip() for cell in split(lines[dialect.start], dialect.separator)]
        header.line = dialect.start + 1
        return _rows(lines, dialect, header, file, dialect.start + 1, whole_end)
    return _rows(lines, dialect, header, file, dialect.start, whole_end)


def _rows(
    lines: list[str], dialect: Dialect, header: TableHeader, file: str, start: int, whole_end: bool
) -> Table:
    separator, fields = dialect.separator, dialect.fields
    numbered, sessions = array("q"), array("q")  # a tenth of the memory of lists
    rows: list[list[str]] = []
    session, comments, alone = 1, 0, 0
    findings: list[Located] = []
    parts: list[list[Any]] = [[] for _ in range(fields)]
    bad: list[list[tuple[int, str]]] = [[] for _ in range(fields)]
    done = 0

    def flush() -> None:
        nonlocal done
        for place, cells in enumerate(zip(*rows, strict=True)):
            if dialect.numeric[place] and not any(is_list(cell) for cell in cells[:3]):
                values, wrong = numbers(cells, dialect.decimal, done)
                parts[place].append(values)
                bad[place] += wrong
            else:
                parts[place].append(np.array([unquoted(cell) for cell in cells], dtype=object))
        done += len(rows)
        rows.clear()

    plain_until = start
    for index in range(start, len(lines)):
        if index < plain_until:
            continue
        if not rows and (plain := _plain(lines[index : index + _CHUNK], dialect, header)) is not None:
            plain_until = index + len(plain)
            for place, column in enumerate(plain.T):
                parts[place].append(column)
            done += len(plain)
            numbered.extend(range(index + 1, plain_until + 1))
            sessions.extend([session] * len(plain))
            continue
        line = lines[index]
        if not line or line.isspace():
            continue
        if line in header.lines and numbered:
            session += 1
            continue
        if line[0] in "#%/" and is_comment(line):
            comments += 1
            continue
        cells = split(line, separator)
        if len(cells) != fields:
            if len(cells) > fields and not any(cell.strip() for cell in cells[fields:]):
                cells = cells[:fields]
            elif not "".join(cells).strip():
                continue
            elif len(cells) > 1 and cells[0].strip() and not "".join(cells[1:]).strip('" '):
                alone += 1
                continue
            else:
                findings.append(_miscounted(line, index, len(lines), len(cells), dialect, file, numbered))
                if len(findings) >= _MAX_FINDINGS:
                    break
                continue
        elif fields > 1 and not line.strip(", ;\t|"):
            continue
        rows.append(cells)
        numbered.append(index + 1)
        sessions.append(session)
        if len(rows) == _CHUNK:
            flush()
    if rows:
        flush()
    if findings:
        raise BadInputError(findings)
    columns = _columns(parts, bad, header, dialect, numbered, file)
    table = Table(
        file, tuple(columns), np.array(numbered, dtype=np.int64), np.array(sessions, dtype=np.int64), lines,
        separator, header.facts, [], header.line,
    )  # fmt: skip
    if alone:
        table.notes.append(
            f"{alone} rows with nothing behind their first cell are lost samples and were left out"
        )
    _notes(table, dialect, comments, session, whole_end)
    return table


def _plain(lines: list[str], dialect: Dialect, header: TableHeader) -> NDArray[np.float64] | None:
    """Lines of nothing but plain numbers, shape ``(lines, fields)``; None where one is anything else."""
    if dialect.separator == " " or dialect.decimal != "." or not all(dialect.numeric):
        return None
    if any(line[:1] not in DIGITS for line in lines) or not header.lines.isdisjoint(lines):
        return None
    try:
        values = np.loadtxt(lines, delimiter=dialect.separator, comments=None, ndmin=2)
    except ValueError:
        return None
    # Not what is lost or infinite, and not integers of more digits than a double has.
    right = values.shape == (len(lines), dialect.fields) and np.abs(values).max() <= EXACT
    return values if right else None


def _columns(
    parts: list[list[Any]], bad: list[list[tuple[int, str]]], header: TableHeader, dialect: Dialect,
    numbered: Sequence[int], file: str,
) -> list[TableColumn]:  # fmt: skip
    columns: list[TableColumn] = []
    for place in range(dialect.fields):
        values = np.concatenate(parts[place]) if len({each.dtype for each in parts[place]}) == 1 else (
            np.concatenate([each.astype(object if each.dtype == object else float) for each in parts[place]])
        )  # fmt: skip
        name, unit = header.names[place], header.units[place]
        if name == "?":
            name = "index"
            counts = values.dtype.kind == "f" and len(values) > 1 and np.all(np.diff(values) == 1)
            if not counts and values.dtype != object:
                message = f"rows have {dialect.fields} cells, the header {dialect.fields - 1} names"
                remedy = "and the first cells do not count rows; add the missing name to the header"
                raise BadInputError([Located(file, header.line, 1, f"{message}, {remedy}")])
        blank = values.dtype.kind == "f" and np.isnan(values).all() and not bad[place]
        if blank and not name:
            continue
        if values.dtype == object and dialect.numeric[place]:
            columns += _expanded(name, place, values, unit, numbered, file)
        else:
            if values.dtype != object and len(bad[place]) * 2 > len(values):
                values = values.astype(object)
            columns.append(TableColumn(name, place + 1, values, unit, tuple(bad[place])))
    return columns


def _expanded(
    name: str, place: int, values: Any, unit: str, numbered: Sequence[int], file: str
) -> list[TableColumn]:
    """Columns of cells that hold lists: ``name[0]``, ``name[1]``."""
    pairs = [listed(cell) for cell in values]
    keys = [key for key, _ in pairs[0] or ()]
    for row, each in enumerate(pairs):
        if each is None or [key for key, _ in each] != keys:
            what = f"column {place + 1} ({name}): {values[row][:40]!r} is no list of {len(keys)} numbers"
            raise BadInputError([Located(file, numbered[row], 1, what)])
    table = np.array([[value for _, value in each or ()] for each in pairs])
    return [TableColumn(f"{name}{key}", place + 1, table[:, at], unit) for at, key in enumerate(keys)]


def _miscounted(
    line: str, index: int, total: int, count: int, dialect: Dialect, file: str, numbered: Sequence[int]
) -> Located:
    places = begins(line, dialect.separator)
    column = places[min(dialect.fields, len(places) - 1)]
    what = f"the row has {count} cells, the others have {dialect.fields}"
    if index == total - 1 and count < dialect.fields:
        what += "; the file ends within a row: delete that line if the rest is enough"
    elif not numbered:
        what += "; is it a header?"
    elif any(sign in line for sign in ";\t|," if sign != dialect.separator):
        what += f"; cells are separated by {dialect.separator!r} here"
    return Located(file, index + 1, column, what)


def _notes(table: Table, dialect: Dialect, comments: int, sessions: int, whole_end: bool) -> None:
    if comments:
        table.notes.append(f"{comments} comment lines among the rows were left out")
    if sessions > 1:
        table.notes.append(f"the header comes {sessions} times: {sessions} sessions")
    if not whole_end and len(table):
        table.notes.append(f"no line end after line {table.lines[-1]}: its last number may be cut")
    for name in _COUNTS:
        stated = number(table.facts.get(name, ""))
        if stated and stated == stated and stated > len(table):
            what = f"{name} is {stated:.0f}, but the file has {len(table)} rows: it was cut"
            remedy = "export it again, or correct that number if the rest is enough"
            place = next((n for n, text in enumerate(table.text, 1) if name in text), 1)
            column = table.text[place - 1].find(name) + 1
            raise BadInputError([Located(table.file, place, column, f"{what}; {remedy}")])
    frames = number(table.facts.get("NumFrames", ""))
    if frames and frames > len(table):
        table.notes.append(f"NumFrames is {frames:.0f}, but the file has {len(table)} rows: was it cut?")


def _counts_up(lines: Sequence[str], dialect: Dialect) -> bool:
    """The first line of numbers counts columns: the header that pandas writes for unnamed ones."""
    cells = [cell.strip() for cell in split(lines[dialect.start], dialect.separator)]
    own = cells[1:] if cells and not cells[0] else cells
    behind = lines[dialect.start + 1] if dialect.start + 1 < len(lines) else ""
    return len(own) > 2 and own == [str(place) for place in range(len(own))] and dialect.decimal in behind


def _transposed(lines: Sequence[str]) -> Callable[[str], Table] | None:
    """A reader of a table whose lines are columns: a name, then many numbers; None for others."""
    given = [(index, line) for index, line in enumerate(lines) if line.strip()]
    if not 2 <= len(given) <= 60:
        return None
    for separator in (",", ";", "\t"):
        cells = [split(line, separator) for _, line in given]
        size = len(cells[0])
        if size < 9 or size < 3 * len(given) or any(len(each) != size for each in cells):
            continue
        decimal = "." if separator == "," else ("," if "," in given[-1][1] else ".")
        if any(is_number(each[0], decimal) or not re.search("[A-Za-z]", each[0]) for each in cells):
            continue
        known = (all(is_number(cell, decimal) or is_lost(cell) for cell in each[1:]) for each in cells)
        if not all(known):
            continue

        def build(
            file: str, cells: list[list[str]] = cells, separator: str = separator, decimal: str = decimal
        ) -> Table:
            columns = []
            for place, each in enumerate(cells):
                values, wrong = numbers(each[1:], decimal, 0)
                name, unit = name_and_unit(each[0].strip())
                columns.append(TableColumn(name, place + 1, values, unit or unit_of_name(name), tuple(wrong)))
            count = len(cells[0]) - 1
            ones = np.ones(count, np.int64)
            note = "each line is a column: the table was turned"
            return Table(file, tuple(columns), ones, ones, lines, separator, {}, [note], 1)

        return build
    return None
