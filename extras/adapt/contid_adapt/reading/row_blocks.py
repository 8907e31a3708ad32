"""Rows of cells, turned into columns of numbers block by block, so that few rows are texts at a time."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from itertools import repeat
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from contid.errors import BadInputError, Located
from contid_adapt.reading.cells import EXACT, is_list, listed, numbers, unquoted
from contid_adapt.reading.dialect import Dialect
from contid_adapt.reading.header import TableHeader
from contid_adapt.reading.table import TableColumn
from contid_adapt.reading.time_text import times_of_texts

#: Rows that are turned into numbers at a time.
BLOCK: Final = 20_000


class RowBlocks:
    """The columns of a table while it is read.

    Attributes:
        lines: the line of each row, from 1.
        sessions: the session of each row, from 1.
    """

    def __init__(self, dialect: Dialect, header: TableHeader, file: str) -> None:
        """An empty table.

        Args:
            dialect: of the text.
            header: the names of the columns.
            file: its name in messages.
        """
        self._dialect, self._header, self._file = dialect, header, file
        self.lines, self.sessions = array("q"), array("q")
        self._cells: list[list[str]] = []
        self._done = 0
        fields = range(dialect.fields)
        self._parts: list[list[NDArray[Any]]] = [[] for _ in fields]
        self._bad: list[list[tuple[int, str]]] = [[] for _ in fields]
        self._texts: list[dict[str, str]] = [{} for _ in fields]

    def add(self, cells: list[str], line: int, session: int) -> None:
        """Add a row; its line counts from 1."""
        self._cells.append(cells)
        self.lines.append(line)
        self.sessions.append(session)
        if len(self._cells) == BLOCK:
            self._flush()

    def add_plain(self, lines: Sequence[str], first: int, session: int) -> bool:
        """Add lines of nothing but plain numbers at once; False, and nothing, where one is anything else.

        Args:
            lines: of the file.
            first: number of the first of them, from 1.
            session: of them all.
        """
        if self._cells or (plain := self._plain(lines)) is None:
            return False
        for place, column in enumerate(plain.T):
            self._parts[place].append(column.copy())
        self._done += len(plain)
        self.lines.extend(range(first, first + len(plain)))
        self.sessions.extend(repeat(session, len(plain)))
        return True

    def _plain(self, lines: Sequence[str]) -> NDArray[np.float64] | None:
        dialect = self._dialect
        if not all(dialect.numeric) or not self._header.lines.isdisjoint(lines):
            return None
        if dialect.decimal == ",":
            if any("." in line for line in lines):
                return None
            lines = [line.replace(",", ".") for line in lines]
        try:
            separator = None if dialect.separator == " " else dialect.separator
            values = np.loadtxt(lines, delimiter=separator, comments=None, ndmin=2)
        except ValueError:
            return None
        # Not what is lost or infinite, and not integers of more digits than a double has.
        right = values.shape == (len(lines), dialect.fields) and np.abs(values).max() <= EXACT
        return values if right else None

    def _flush(self) -> None:
        """Turn the rows that are texts into numbers."""
        for place, cells in enumerate(zip(*self._cells, strict=True)):
            if self._dialect.numeric[place] and not any(is_list(cell) for cell in cells[:3]):
                values, wrong = numbers(cells, self._dialect.decimal, self._done)
                self._parts[place].append(values)
                self._bad[place] += wrong
            else:
                # A text that comes again is kept once.
                known = self._texts[place]
                texts = [known.setdefault(text, text) for text in map(unquoted, cells)]
                self._parts[place].append(np.array(texts, dtype=object))
        self._done += len(self._cells)
        self._cells.clear()

    def columns(self, notes: list[str]) -> list[TableColumn]:
        """The columns; what was decided about them is added to the notes.

        Raises:
            BadInputError: a nameless column that does not count rows, or cells with lists of other lengths.
        """
        self._flush()
        columns: list[TableColumn] = []
        for place in range(self._dialect.fields):
            columns += self._columns_of(place, notes)
            self._parts[place].clear()
        return columns

    def _columns_of(self, place: int, notes: list[str]) -> list[TableColumn]:
        """The columns of a field: none where it is empty, several where its cells hold lists."""
        values, bad = _joined(self._parts[place]), self._bad[place]
        name, unit = self._header.names[place], self._header.units[place]
        if name == "?":
            name = "index"
            self._check_index(values)
        if values.dtype.kind == "f" and np.isnan(values).all() and not bad and not name:
            return []
        if values.dtype == object:
            if self._dialect.numeric[place]:
                return self._expanded(name, place, values, unit)
            if (times := times_of_texts(values.tolist())) is not None:
                notes.append(f"{name or f'c{place + 1}'}: times were read as {times.since}")
                return [TableColumn(name, place + 1, times.values, "ns", tuple(times.bad))]
        elif len(bad) * 2 > len(values):
            values = values.astype(object)
        return [TableColumn(name, place + 1, values, unit, tuple(bad))]

    def _check_index(self, values: NDArray[Any]) -> None:
        counts = values.dtype.kind == "f" and len(values) > 1 and np.all(np.diff(values) == 1)
        if not counts and values.dtype != object:
            fields = self._dialect.fields
            message = f"rows have {fields} cells, the header {fields - 1} names"
            remedy = "and the first cells do not count rows; add the missing name to the header"
            raise BadInputError([Located(self._file, self._header.line, 1, f"{message}, {remedy}")])

    def _expanded(self, name: str, place: int, values: NDArray[Any], unit: str) -> list[TableColumn]:
        """Columns of cells that hold lists: ``name[0]``, ``name[1]``."""
        pairs = [listed(cell) for cell in values]
        keys = [key for key, _ in pairs[0] or ()]
        for row, each in enumerate(pairs):
            if each is None or [key for key, _ in each] != keys:
                what = f"column {place + 1} ({name}): {values[row][:40]!r} is no list of {len(keys)} numbers"
                raise BadInputError([Located(self._file, self.lines[row], 1, what)])
        table = np.array([[value for _, value in each or ()] for each in pairs])
        return [TableColumn(f"{name}{key}", place + 1, table[:, at], unit) for at, key in enumerate(keys)]


def _joined(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """One column of its blocks; objects where one has them, else doubles where they differ."""
    kinds = {part.dtype for part in parts}
    if len(kinds) == 1:
        return np.concatenate(parts)
    return np.concatenate([part.astype(object if part.dtype == object else float) for part in parts])
