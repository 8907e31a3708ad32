"""Measurements as CSV: named columns of numbers, every wrong cell named with its line and column."""

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
    """Columns a table may have; every one holds numbers unless it is among ``message``.

    Attributes:
        choices: groups of columns; of every group exactly one alternative must be there, an alternative being
            names joined by commas (``"x_px,y_px"`` or ``"x_mm,y_mm"``).
        message: columns of text that must be there.
        optional: columns that may be missing, and whose cells may be empty.
        optional_words: the same, of text.
    """

    choices: Sequence[Sequence[str]]
    message: Sequence[str] = ()
    optional: Sequence[str] = ()
    optional_words: Sequence[str] = ()

    @property
    def known(self) -> list[str]:
        """All of them."""
        chosen = [column for group in self.choices for each in group for column in each.split(",")]
        return [*self.message, *chosen, *self.optional, *self.optional_words]

    @property
    def example(self) -> str:
        """A header that would do."""
        return ",".join([*self.message, *(group[0] for group in self.choices)])


@dataclass(frozen=True, slots=True)
class MeasuredRow:
    """One row: where it stands, and its cells by column, without the empty ones.

    Attributes:
        name: what messages call the file.
        line: of the file, from 1.
        places: number of each column, from 1.
        numbers: by column.
        message: by column.
    """

    name: str
    line: int
    places: Mapping[str, int]
    numbers: dict[str, float]
    message: dict[str, str]

    def wrong(self, column: str, message: str) -> Located:
        """A finding about one cell."""
        return Located(self.name, self.line, self.places[column], f"{column}: {message}")


#: What is wrong with a row all of whose cells are right.
RowCheck: TypeAlias = Callable[[MeasuredRow], Iterable[Located]]


def read_measured(
    lines: Iterable[str], name: str, columns: Columns, check: RowCheck = lambda row: ()
) -> list[MeasuredRow]:
    """Parse a file; comment lines start with ``#``.

    Args:
        lines: the text.
        name: what messages call it.
        columns: it may have.
        check: asked about every row whose cells are right.

    Raises:
        BadInputError: every wrong row, with line and column.
    """
    places: dict[str, int] = {}
    findings: list[Located] = []
    rows: list[MeasuredRow] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in next(csv.reader([line]))]
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


def _check_header(header: list[str], name: str, line: int, columns: Columns) -> list[Located]:
    known = columns.known
    findings = []
    for place, cell in enumerate(header, start=1):
        if cell not in known:
            near = difflib.get_close_matches(cell, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            message = f"unknown column {cell!r}; there are {', '.join(known)}{hint}"
            findings.append(Located(name, line, place, message))
        elif cell in header[: place - 1]:
            findings.append(Located(name, line, place, f"column {cell!r} is there twice"))
    for group in columns.choices:
        given = [each for each in group if all(column in header for column in each.split(","))]
        if len(given) != 1:
            found = "none of them" if not given else "more than one of them"
            findings.append(Located(name, line, 1, f"give {' or '.join(group)}; there is {found}"))
    findings += [
        Located(name, line, 1, f"column {word} is missing") for word in columns.message if word not in header
    ]
    return findings


def _fill(row: MeasuredRow, cells: list[str], columns: Columns) -> Iterator[Located]:
    """Put the cells into the row; yields those that are no numbers."""
    for column, text in zip(row.places, cells, strict=True):
        if not text and (column in columns.optional or column in columns.optional_words):
            continue
        if column in columns.message or column in columns.optional_words:
            row.message[column] = text
            continue
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            row.numbers[column] = value
        else:
            yield row.wrong(column, f"{text!r} is no number")
