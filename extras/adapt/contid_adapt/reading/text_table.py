"""A text to a table: dialect, header, rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from contid.errors import BadInputError, Located
from contid_adapt.reading.cells import begins, number, split
from contid_adapt.reading.dialect import Dialect, find_dialect, is_comment
from contid_adapt.reading.header import TableHeader, read_header
from contid_adapt.reading.labelled import labelled_table
from contid_adapt.reading.preamble import nexus_table
from contid_adapt.reading.row_blocks import BLOCK, RowBlocks
from contid_adapt.reading.table import Table
from contid_adapt.reading.transposed import transposed_table

_MAX_FINDINGS: Final = 20
#: Lines that a footer may have, and characters in each.
_FOOTER: Final = 3
_LONGEST: Final = 100
#: What Motive and QTM call the number of rows of a file.
_COUNTS: Final = ("Total Exported Frames", "NO_OF_FRAMES")


def read_text(lines: Sequence[str], file: str, whole_end: bool = True) -> Table:
    """The table of the lines of a text.

    Args:
        lines: of the file.
        file: its name in messages.
        whole_end: the file ends with the end of a line.

    Raises:
        BadInputError: rows of other counts of cells, or no rows.
    """
    for reader in (transposed_table, labelled_table):
        if (table := reader(lines, file)) is not None:
            return table
    part = nexus_table(lines)
    if part is not None and (part.begin > 0 or part.end < len(lines)):
        # The same numbers of lines, with the other tables left empty.
        lines = [*[""] * part.begin, *lines[part.begin : part.end]]
    dialect = find_dialect(lines, file)
    header = read_header(lines, dialect, file)
    if not header.line and not any(header.names) and _counts_up(lines, dialect):
        header.names = [cell.strip() for cell in split(lines[dialect.start], dialect.separator)]
        header.line = dialect.start + 1
        dialect = replace(dialect, start=dialect.start + 1)
    rows = _RowLines(lines, dialect, header, file)
    rows.read()
    notes: list[str] = [part.note] if part is not None and part.note else []
    columns = rows.blocks.columns(notes)
    table = Table(
        file, tuple(columns), np.array(rows.blocks.lines), np.array(rows.blocks.sessions), lines,
        dialect.separator, header.facts, notes, header.line,
    )  # fmt: skip
    notes += rows.notes()
    _check_stated_counts(table, whole_end)
    return table


class _RowLines:
    """Reads the lines from the first row on."""

    def __init__(self, lines: Sequence[str], dialect: Dialect, header: TableHeader, file: str) -> None:
        self.blocks = RowBlocks(dialect, header, file)
        self._lines, self._dialect, self._header, self._file = lines, dialect, header, file
        self._session, self._comments, self._behind, self._alone = 1, 0, 0, 0
        self._footer = ""

    def read(self) -> None:
        """Read every line.

        Raises:
            BadInputError: rows of other counts of cells.
        """
        findings: list[Located] = []
        index = self._dialect.start
        while index < len(self._lines):
            block = self._lines[index : index + BLOCK]
            if not self.blocks.add_plain(block, index + 1, self._session):
                for at, line in enumerate(block, index):
                    if (found := self._take(line, at)) is not None:
                        findings.append(found)
                    if self._footer or len(findings) >= _MAX_FINDINGS:
                        break
            if self._footer or len(findings) >= _MAX_FINDINGS:
                break
            index += len(block)
        if findings:
            raise BadInputError(findings)

    def _take(self, line: str, index: int) -> Located | None:
        """Take a line as a row, or as what it is else; the finding of one that is wrong."""
        fields = self._dialect.fields
        if not line or line.isspace():
            return None
        if line in self._header.lines and self.blocks.lines:
            self._session += 1
            return None
        if line[0] in "#%/" and is_comment(line):
            self._comments += 1
            return None
        cells = split(line, self._dialect.separator)
        if self._dialect.comments and len(cells) > fields:
            self._behind += any(cell.strip() for cell in cells[fields:])
            cells = cells[:fields]
        if len(cells) == fields:
            if fields == 1 or line.strip(", ;\t|"):
                self.blocks.add(cells, index + 1, self._session)
            return None
        if len(cells) > fields and not any(cell.strip() for cell in cells[fields:]):
            self.blocks.add(cells[:fields], index + 1, self._session)
            return None
        if not "".join(cells).strip():
            return None
        if len(cells) > 1 and cells[0].strip() and not "".join(cells[1:]).strip('" '):
            self._alone += 1
            return None
        if self._is_footer(cells, index):
            self._footer = f"line {index + 1} and below is no row and was left out: {line.strip()[:40]!r}"
            return None
        return self._miscounted(line, index, len(cells))

    def _is_footer(self, cells: Sequence[str], index: int) -> bool:
        """True for a line of one cell with letters at the end: ``(401 rows)``; at most three such lines."""
        rest = self._lines[index : index + _FOOTER + 1]
        if len(cells) > 1 or len(rest) > _FOOTER or not self.blocks.lines:
            return False
        parts = [split(line[:_LONGEST], self._dialect.separator) for line in rest if line.strip()]
        if any(len(line) > _LONGEST for line in rest):
            return False
        return all(len(each) == 1 and sum(map(str.isalpha, each[0])) > 2 for each in parts)

    def _miscounted(self, line: str, index: int, count: int) -> Located:
        fields, separator = self._dialect.fields, self._dialect.separator
        places = begins(line, separator)
        column = places[min(fields, len(places) - 1)]
        what = f"the row has {count} cells, the others have {fields}"
        if index == len(self._lines) - 1 and count < fields:
            what += "; the file ends within a row: delete that line if the rest is enough"
        elif not self.blocks.lines:
            what += "; is it a header?"
        elif any(sign in line for sign in ";\t|," if sign != separator):
            what += f"; cells are separated by {separator!r} here"
        return Located(self._file, index + 1, column, what)

    def notes(self) -> list[str]:
        """What was left out, one sentence each."""
        notes = []
        if self._alone:
            what = "rows with nothing behind their first cell are lost samples and were left out"
            notes.append(f"{self._alone} {what}")
        if self._comments:
            notes.append(f"{self._comments} comment lines among the rows were left out")
        if self._behind:
            notes.append(f"the comments behind {self._behind} rows were left out")
        if self._footer:
            notes.append(self._footer)
        if self._session > 1:
            notes.append(f"the header comes {self._session} times: {self._session} sessions")
        return notes


def _check_stated_counts(table: Table, whole_end: bool) -> None:
    """Refuse a table with fewer rows than it states, and note what may have been cut."""
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
