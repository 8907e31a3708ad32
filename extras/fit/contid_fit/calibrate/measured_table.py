"""Measurements as CSV: named columns of numbers; every invalid cell is reported with line and column."""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from contid.errors import BadInputError, Located


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns a table may have; they hold numbers where nothing else is stated.

    Attributes:
        choices: groups of alternatives, exactly one of each group is required; an alternative is one name or
            several joined by commas (``"x_px,y_px"`` or ``"x_mm,y_mm"``).
        text: required columns of text, such as a label; a cell of them may be empty, which is the text "".
        optional: columns that may be missing and whose cells may be empty.
        optional_text: columns of text that may be missing; a row has no text for an empty cell.
    """

    choices: Sequence[Sequence[str]]
    text: Sequence[str] = ()
    optional: Sequence[str] = ()
    optional_text: Sequence[str] = ()

    @property
    def names(self) -> list[str]:
        """All columns."""
        chosen = [column for group in self.choices for names in group for column in names.split(",")]
        return [*self.text, *chosen, *self.optional, *self.optional_text]

    @property
    def example(self) -> str:
        """A valid header."""
        return ",".join([*self.text, *(group[0] for group in self.choices)])


@dataclass(frozen=True, slots=True)
class MeasuredRow:
    """One row: its location, and its cells.

    Attributes:
        name: name of the file in messages.
        line: number of the line in the file, from 1.
        places: number of each column, from 1.
        numbers: numbers by column; empty cells of optional columns are left out.
        text: texts by column; likewise.
    """

    name: str
    line: int
    places: Mapping[str, int]
    numbers: dict[str, float]
    text: dict[str, str]

    def finding(self, column: str, message: str) -> Located:
        """A located message about one cell."""
        return Located(self.name, self.line, self.places[column], f"{column}: {message}")


#: Findings about a row whose cells are valid one by one.
RowCheck: TypeAlias = Callable[[MeasuredRow], Iterable[Located]]


def read_measured(
    lines: Iterable[str], name: str, columns: Columns, check: RowCheck = lambda row: ()
) -> list[MeasuredRow]:
    """Parse a file; comment lines start with ``#``.

    Args:
        lines: lines of the text.
        name: name of the file in messages.
        columns: allowed columns.
        check: called for every row whose cells are valid; returns what is wrong with it.

    Returns:
        The rows below the header, at least one.

    Raises:
        BadInputError: every invalid row, with line and column.
    """
    places: dict[str, int] = {}
    findings: list[Located] = []
    rows: list[MeasuredRow] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            cells = cells_of(line)
        except csv.Error as error:
            raise BadInputError(
                [*findings, Located(name, number, 1, f"not a row of a table: {error}")]
            ) from None
        if not places:
            findings += _check_header(cells, name, number, columns)
            if findings:
                raise BadInputError(findings)
            places = {column: place for place, column in enumerate(cells, start=1)}
        elif len(cells) != len(places):
            findings.append(Located(name, number, 1, f"{len(cells)} cells, the header has {len(places)}"))
        else:
            row = MeasuredRow(name, number, places, {}, {})
            findings += list(_fill(row, cells, columns)) or check(row)
            rows.append(row)
    if not places:
        message = f"empty; the first line names the columns, such as {columns.example}"
        findings.append(Located(name, 1, 1, message))
    elif not rows and not findings:
        findings.append(Located(name, 1, 1, "a header without rows"))
    if findings:
        raise BadInputError(findings)
    return rows


def cells_of(line: str) -> list[str]:
    """The cells of a line, without blanks around them.

    Raises:
        csv.Error: one is too long for a table.
    """
    return [cell.strip() for cell in next(csv.reader([line]), [])]


def _check_header(header: list[str], name: str, line: int, columns: Columns) -> list[Located]:
    """What is wrong with a header: unknown, repeated, missing and contradicting columns."""
    names = columns.names
    findings = []
    for place, cell in enumerate(header, start=1):
        if cell not in names:
            near = difflib.get_close_matches(cell, names, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            message = f"unknown column {cell!r}; allowed: {', '.join(names)}{hint}"
            findings.append(Located(name, line, place, message))
        elif cell in header[: place - 1]:
            findings.append(Located(name, line, place, f"column {cell!r} occurs twice"))
    for group in columns.choices:
        complete = [
            alternative for alternative in group if all(column in header for column in alternative.split(","))
        ]
        if len(complete) != 1:
            found = "several" if complete else "none"
            findings.append(Located(name, line, 1, f"give {' or '.join(group)}; found {found}"))
    findings += [
        Located(name, line, 1, f"column {column} is missing")
        for column in columns.text
        if column not in header
    ]
    return findings


def _fill(row: MeasuredRow, cells: list[str], columns: Columns) -> Iterator[Located]:
    """Put the cells into the row; yields a finding for each that is not a number."""
    for column, text in zip(row.places, cells, strict=True):
        if not text and column in (*columns.optional, *columns.optional_text):
            continue
        if column in (*columns.text, *columns.optional_text):
            row.text[column] = text
            continue
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            row.numbers[column] = value
        else:
            yield row.finding(column, f"{text!r} is not a finite number")
