"""A table as it was read: named columns, the line of every row, and what was noticed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from contid.errors import BadInputError, Located

#: What cells hold where a sample was lost.
LOST: Final = frozenset({"", "nan", "na", "n/a", "null", "none", "-nan", "nan(ind)", "-nan(ind)", "missing"})
_NOT_A_NAME: Final = re.compile(r"[^A-Za-z0-9_.\[\]]+")


@dataclass(frozen=True, slots=True)
class TableColumn:
    """One column.

    Attributes:
        name: as written, with the names of the header rows above in front.
        position: of the field in a line, from 1.
        values: shape ``(rows,)``: float64 with NaN where lost, int64 where doubles would lose digits, or str.
        unit: that the file states, "" for none.
        bad: rows and cells that are no numbers in a column of numbers.
    """

    name: str
    position: int
    values: NDArray[Any]
    unit: str = ""
    bad: tuple[tuple[int, str], ...] = ()

    @property
    def alias(self) -> str:
        """The name with an underscore for each run of characters that an expression cannot have."""
        return _NOT_A_NAME.sub("_", self.name).strip("_")

    @property
    def is_text(self) -> bool:
        """True for a column of words."""
        return self.values.dtype.kind in "OU"


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of equal length.

    Attributes:
        file: name for messages.
        columns: in the order of the file.
        lines: line of every row, from 1, shape ``(rows,)``; its number where rows have no lines of their own.
        sessions: number of the session of every row, from 1; a header that comes again begins the next.
        text: lines of the file, to locate cells in; empty for files that are no text.
        separator: of the cells, " " for blanks.
        facts: what lines above the header state: ``{"Length Units": "Meters"}``.
        notes: what was noticed on the way, one sentence each.
        names_line: line of the header, 0 for none.
    """

    file: str
    columns: tuple[TableColumn, ...]
    lines: NDArray[np.int64]
    sessions: NDArray[np.int64]
    text: Sequence[str] = ()
    separator: str = ","
    facts: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    names_line: int = 0

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.lines)

    def at(self, row: int, column: TableColumn | None, message: str) -> Located:
        """A finding at the cell of a row."""
        line = int(self.lines[row]) if len(self.lines) else 1
        return Located(self.file, line, self._place(line, column), message)

    def column(self, name: str) -> TableColumn:
        """A column by its name, its alias, or its position (``c3``).

        Raises:
            BadInputError: unknown, or ambiguous.
        """
        found = [each for each in self.columns if name in (each.name, each.alias)]
        if len(found) == 1:
            return found[0]
        place = re.fullmatch(r"c([1-9]\d{0,3})", name)
        if not found and place and (at := [c for c in self.columns if c.position == int(place[1])]):
            return at[0]
        line = max(self.names_line, 1)
        if found:
            choice = " or ".join(f"c{each.position}" for each in found)
            what = f"the name {name!r} stands {len(found)} times; write {choice}"
            raise BadInputError([Located(self.file, line, self._place(line, found[1]), what)])
        raise BadInputError([Located(self.file, line, 1, f"no column {name!r}; {self.named(name)}")])

    def named(self, wrong: str = "") -> str:
        """The names there are, and the nearest."""
        import difflib

        names = [each.alias or f"c{each.position}" for each in self.columns]
        shown = ", ".join(names[:40]) + (", .." if len(names) > 40 else "")
        near = difflib.get_close_matches(wrong, names, n=1) if wrong else []
        return f"the file has: {shown}" + (f"; did you mean {near[0]!r}?" if near else "")

    def chosen(self, keep: NDArray[np.bool_]) -> Table:
        """The table with some of its rows; itself with all."""
        if keep.all():
            return self
        kept, number = np.flatnonzero(keep), np.cumsum(keep) - 1
        columns = tuple(
            TableColumn(
                each.name, each.position, each.values[kept], each.unit,
                tuple((int(number[row]), cell) for row, cell in each.bad if keep[row]),
            )
            for each in self.columns
        )  # fmt: skip
        rest = (self.text, self.separator, self.facts, self.notes, self.names_line)
        return Table(self.file, columns, self.lines[kept], self.sessions[kept], *rest)

    def _place(self, line: int, column: TableColumn | None) -> int:
        """Column of a cell in its line, from 1."""
        if column is None or not 1 <= line <= len(self.text):
            return 1
        from contid_adapt.reading.cells import begins

        places = begins(self.text[line - 1], self.separator)
        return places[min(column.position, len(places)) - 1]
