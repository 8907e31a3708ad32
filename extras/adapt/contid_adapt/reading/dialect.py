"""What separates the cells of a text, its decimal sign, and where its rows of numbers begin.

Judged on lines from the whole file: those of rows outnumber those of headers.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from contid.errors import BadInputError, Located
from contid_adapt.reading.cells import is_lost, is_number, split

#: Lines that are looked at to decide, but for one more.
_SAMPLE: Final = 120
_SEPARATORS: Final = (",", ";", "\t", "|", " ")
_COMMENT: Final = ("#", "%", "//")
#: The first line of a file may name its separator, as Excel has it.
_NAMED_SEPARATOR: Final = re.compile(r'^"?sep=(.)"?')


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text is written.

    Attributes:
        separator: of cells; " " for any run of blanks.
        decimal: sign, "." or ",".
        fields: cells of a row.
        numeric: for each field, whether its cells are numbers, but for lost samples.
        start: index of the first line with numbers.
    """

    separator: str
    decimal: str
    fields: int
    numeric: tuple[bool, ...]
    start: int


#: A line that begins with one of these is no comment and not empty; few headers do.
DIGITS: Final = frozenset("0123456789-")


def is_comment(line: str) -> bool:
    """True for a line that begins with a sign of comments."""
    return line.lstrip().startswith(_COMMENT)


def names_separator(line: str) -> re.Match[str] | None:
    """The separator, as group 1, of a line such as ``sep=;``; None for any other."""
    return _NAMED_SEPARATOR.match(line)


def find_dialect(lines: Sequence[str], file: str) -> Dialect:
    """Find the dialect of a text.

    Raises:
        BadInputError: no rows of numbers.
    """
    named = names_separator(lines[0])
    rows = [
        index
        for index, line in enumerate(lines)
        if line[:1] in DIGITS or (line.strip() and not is_comment(line))
    ]
    if named:
        rows = rows[1:]
    if not rows:
        raise BadInputError([Located(file, 1, 1, "no rows: every line is a comment or empty")])
    # Of long files from the second half, which has no header.
    behind = rows[len(rows) // 2 :] if len(rows) > 8 else rows
    step = max(len(behind) // _SAMPLE, 1)
    sample = [lines[index] for index in behind[::step]][: _SAMPLE + 1]
    best: tuple[float, str, str] | None = None
    for separator in (named[1],) if named else _SEPARATORS:
        for decimal in (".",) if separator == "," else (".", ","):
            score = _score(sample, separator, decimal)
            if best is None or score > best[0]:
                best = (score, separator, decimal)
    assert best is not None
    score, separator, decimal = best
    if score <= 0.0:
        raise BadInputError([Located(file, rows[0] + 1, 1, "no rows of numbers were found")])
    rows_only, fields = _rows_only([split(line, separator) for line in sample], decimal)
    typical = [cells for cells in rows_only if len(cells) == fields]
    numeric = tuple(_is_numeric([cells[place] for cells in typical], decimal) for place in range(fields))
    for place, index in enumerate(rows):
        cells = split(lines[index], separator)
        if is_row(cells, fields, numeric, decimal):
            # Vicon's rate, the counts of a TRC file: few numbers or a word among them, and the names below.
            below = [split(lines[each], separator) for each in rows[place + 1 : place + 3]]
            texts = sum(not is_number(cell, decimal) for cell, own in zip(cells, numeric, strict=True) if own)
            sparse = fields > 2 and (texts > sum(map(is_lost, cells)) or 2 * texts > fields)
            if sparse and not all(is_row(each, fields, numeric, decimal) for each in below):
                continue
            return Dialect(separator, decimal, fields, numeric, index)
    raise BadInputError([Located(file, rows[0] + 1, 1, "no rows of numbers were found")])


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
