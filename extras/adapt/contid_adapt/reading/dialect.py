"""What separates the cells of a text, its decimal sign, and where its rows of numbers begin.

Judged on lines from the whole file: those of rows outnumber those of headers.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Final

import numpy as np

from contid.errors import BadInputError, Located
from contid_adapt.reading.cells import is_lost, is_number, split
from contid_adapt.reading.time_text import looks_like_time

#: Lines that are looked at to decide, where there are more than a few.
_SAMPLE: Final = 120
_FEW: Final = 8
#: Lines among which the end of a preamble of LabVIEW is looked for, and what it begins with.
_MOST_ABOVE: Final = 200
_END_OF_PREAMBLE: Final = "***End_of_Header***"
#: LabVIEW's name of the last column, whose cells only rows with a comment have.
COMMENTS: Final = "Comment"
_SEPARATORS: Final = (",", ";", "\t", "|", " ")
_COMMENT: Final = ("#", "%", "//")
#: The first line of a file may name its separator, as Excel has it.
_NAMED_SEPARATOR: Final = re.compile(r'^"?sep=(.)"?')
_QUOTED_COMMA: Final = re.compile(r'"\s*[-+]?\d*,\d+\s*"')
_THOUSANDS: Final = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+")


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text is written.

    Attributes:
        separator: of cells; " " for any run of blanks.
        decimal: sign, "." or ",".
        fields: cells of a row.
        numeric: for each field, whether its cells are numbers, but for lost samples.
        start: index of the first line with numbers.
        comments: rows may have a comment behind their cells, as LabVIEW writes them.
    """

    separator: str
    decimal: str
    fields: int
    numeric: tuple[bool, ...]
    start: int
    comments: bool

    def cells(self, line: str) -> list[str]:
        """The cells of a line, without its comment."""
        cells = split(line, self.separator)
        return cells[: self.fields] if self.comments else cells


def is_comment(line: str) -> bool:
    """True for a line that begins with a sign of comments."""
    return line.lstrip().startswith(_COMMENT)


def ends_preamble(line: str) -> bool:
    """True for the line behind each of the two parts of a preamble of LabVIEW."""
    return line.startswith(_END_OF_PREAMBLE)


def names_separator(line: str) -> re.Match[str] | None:
    """The separator, as group 1, of a line such as ``sep=;``; None for any other."""
    return _NAMED_SEPARATOR.match(line)


def find_dialect(lines: Sequence[str], file: str) -> Dialect:
    """Find the dialect of a text.

    Raises:
        BadInputError: no rows of numbers.
    """
    named = names_separator(lines[0])
    begin = max(
        [int(bool(named)), *(at + 1 for at, line in enumerate(lines[:_MOST_ABOVE]) if ends_preamble(line))]
    )
    given = list(islice(_given(lines, begin), _FEW + 1))
    if not given:
        raise BadInputError([Located(file, 1, 1, "no rows: every line is a comment or empty")])
    sample = [lines[index] for index in (given if len(given) <= _FEW else _sampled(lines))]
    separator, decimal = _signs(sample, named[1] if named else "", file, given[0] + 1)
    heading = [cell.strip() for cell in split(lines[given[0]], separator)]
    comments = begin > 0 and not named and heading[-1] == COMMENTS
    most = len(heading) - 1 if comments else None
    rows_only, fields = _rows_only([split(line, separator)[:most] for line in sample], decimal)
    typical = [cells for cells in rows_only if len(cells) == fields]
    numeric = tuple(_is_numeric([cells[place] for cells in typical], decimal) for place in range(fields))
    if (separator, decimal) == (",", ","):
        own = [cell for cells in typical for cell, is_own in zip(cells, numeric, strict=True) if is_own]
        _check_thousands(own, lines, file)
    dialect = Dialect(separator, decimal, fields, numeric, 0, comments)
    for index in _given(lines, begin):
        cells = dialect.cells(lines[index])
        if is_row(cells, fields, numeric, decimal) and _begins(cells, index, lines, dialect):
            return replace(dialect, start=_lost_above(index, lines, dialect))
    raise BadInputError([Located(file, given[0] + 1, 1, "no rows of numbers were found")])


def _given(lines: Sequence[str], begin: int) -> Iterator[int]:
    """The indices of lines that are neither empty nor comments."""
    return (
        index for index in range(begin, len(lines)) if (line := lines[index]).strip() and not is_comment(line)
    )


def _sampled(lines: Sequence[str]) -> list[int]:
    """Indices of lines in even steps through the second half of a long file, which has no header."""
    half = len(lines) // 2
    found = [next(_given(lines, int(at)), -1) for at in np.linspace(half, len(lines) - 1, _SAMPLE)]
    return [*dict.fromkeys(index for index in found if index >= 0)]


def _signs(sample: Sequence[str], named: str, file: str, line: int) -> tuple[str, str]:
    """The separator and the decimal sign with which most cells of most lines are numbers.

    A decimal comma between commas is one in quotes: ``"0,01","20,5"``.
    """
    choices = [
        (separator, decimal)
        for separator in ((named,) if named else _SEPARATORS)
        for decimal in (".", ",")
        if (separator, decimal) != (",", ",") or _has_quoted_commas(sample)
    ]
    scores = [_score(sample, *each) for each in choices]
    if max(scores) <= 0.0:
        raise BadInputError([Located(file, line, 1, "no rows of numbers were found")])
    return choices[scores.index(max(scores))]


def _has_quoted_commas(sample: Sequence[str]) -> bool:
    return any(_QUOTED_COMMA.search(line) for line in sample)


def _check_thousands(cells: Sequence[str], lines: Sequence[str], file: str) -> None:
    """Refuse commas that may be signs of thousands: each is followed by three digits, and none by a zero.

    Args:
        cells: of columns of numbers, in a table with a decimal comma between commas.
        lines: of the file.
        file: its name in messages.
    """
    given = [cell for cell in cells if "," in cell]
    if given and all(_THOUSANDS.fullmatch(cell) for cell in given):
        message = f"{given[0]!r}: is its comma a decimal sign, or one of thousands? export without either"
        line = next(number for number, line in enumerate(lines, 1) if given[0] in line)
        raise BadInputError([Located(file, line, 1, message)])


def _begins(cells: Sequence[str], index: int, lines: Sequence[str], dialect: Dialect) -> bool:
    """True for a line that looks like a row and is the first one.

    Vicon's rate and the counts of a TRC file are none: few numbers or a word among them, and the names below.
    """
    fields, numeric, decimal = dialect.fields, dialect.numeric, dialect.decimal
    below = [dialect.cells(lines[each]) for each in islice(_given(lines, index + 1), 2)]
    rows = [is_row(each, fields, numeric, decimal) for each in below]
    if below and not any(rows):
        return False  # Numbers of rigid bodies, with names below.
    texts = sum(not is_number(cell, decimal) for cell, own in zip(cells, numeric, strict=True) if own)
    sparse = fields > 2 and (texts > sum(map(is_lost, cells)) or 2 * texts > fields)
    return not sparse or all(rows)


def _lost_above(start: int, lines: Sequence[str], dialect: Dialect) -> int:
    """The index of the first row, where samples are lost from there to the first one with numbers."""
    for index in range(start - 1, -1, -1):
        cells = dialect.cells(lines[index])
        if len(cells) != dialect.fields:
            break
        own = [cell for cell, numeric in zip(cells, dialect.numeric, strict=True) if numeric]
        stated = any(cell.strip() for cell in own) or any(map(looks_like_time, cells))
        if not own or not all(map(is_lost, own)) or not stated:
            break
        start = index
    return start


def is_row(cells: Sequence[str], fields: int, numeric: Sequence[bool], decimal: str) -> bool:
    """True for a line of numbers, by its cells that should be numbers.

    One of them is a number, more than half of them are numbers or lost samples, and half of those that are
    not lost are numbers.
    """
    if len(cells) != fields:
        return False
    own = [cell for cell, is_own in zip(cells, numeric, strict=True) if is_own]
    right = sum(is_number(cell, decimal) for cell in own)
    lost = sum(is_lost(cell) for cell in own)
    return right > 0 and 2 * (right + lost) > len(own) and 2 * right >= len(own) - lost


def _rows_only(lines: Sequence[list[str]], decimal: str) -> tuple[Sequence[list[str]], int]:
    """The lines of numbers, or all where there is none; and the count of cells that they have."""
    rows = [cells for cells in lines if _mostly_numbers(cells, decimal)] or lines
    return rows, _usual_count(rows, decimal)


def _usual_count(rows: Sequence[Sequence[str]], decimal: str) -> int:
    """The count of cells of most numbers: lines of a key and a number are short."""
    found: Counter[int] = Counter()
    for cells in rows:
        found[len(cells)] += 1 + sum(is_number(cell, decimal) for cell in cells)
    return found.most_common(1)[0][0]


def _mostly_numbers(cells: Sequence[str], decimal: str) -> bool:
    given = [cell for cell in cells if not is_lost(cell)]
    right = sum(is_number(cell, decimal) for cell in given)
    return right > 0 and 2 * right >= len(given)


def _score(sample: Sequence[str], separator: str, decimal: str) -> float:
    rows = [split(line, separator) for line in sample]
    _, fields = _rows_only(rows, decimal)
    total = 0.0
    for cells in rows:
        if len(cells) == fields:
            right = sum(is_number(cell, decimal) for cell in cells)
            lost = sum(is_lost(cell) for cell in cells)
            total += right * (right + lost) / len(cells)
    # One cell of a line is a table of one column only when nothing else fits.
    return total / len(rows) * (1.0 if fields > 1 else 0.1)


def _is_numeric(cells: Sequence[str], decimal: str) -> bool:
    given = [cell for cell in cells if not is_lost(cell)]
    return not given or 2 * sum(is_number(cell, decimal) for cell in given) > len(given)
