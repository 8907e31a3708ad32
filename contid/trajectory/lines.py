"""The lines of a CSV or NDJSON text: their numbers, comments, and which of them is the header."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple, TextIO

from contid.units import MAX_LINE

#: Most rows begin with one of these; such a line is no comment.
_BEGINS: Final = frozenset("0123456789-")
#: Of a live stream that ends amid a row, as where its producer was killed.
CUT: Final = "the last row has no end of line and may be cut off: not followed"
#: Of a trajectory without a column of times.
NO_TIMES: Final = "no column 't_s': a trajectory with times begins with it"


def numbered_lines(stream: TextIO) -> Iterator[tuple[int, str]]:
    """Lines with their numbers from 1, without line ends, cut at `MAX_LINE` + 1 characters."""
    number = 0
    while line := stream.readline(MAX_LINE + 1):
        number += 1
        yield number, line.rstrip("\r\n") if number > 1 else line.rstrip("\r\n").removeprefix("\ufeff")
        if len(line) <= MAX_LINE:
            continue
        while not line.endswith("\n"):
            if len(line := stream.readline(MAX_LINE + 1)) <= MAX_LINE:
                break


def is_comment(line: str) -> bool:
    """True for blank lines and those beginning with ``#``."""
    text = line.lstrip()
    return not text or text.startswith("#")


class FoundHeader(NamedTuple):
    """A header.

    Attributes:
        number: of its line.
        text: the names of the columns, or a first object of NDJSON.
        on_row: the line in which the search ended is the first row too.
    """

    number: int
    text: str
    on_row: bool


class HeaderSearch:
    """Looks for the header in one line after the other.

    It is the first line that is no comment, or the last comment before it, in which ``numpy.savetxt`` writes
    the names of the columns.
    """

    def __init__(self) -> None:
        self._comment = 0, ""

    def take(self, number: int, line: str) -> FoundHeader | None:
        """Take the next line; the header once it is found, which ends the search."""
        if is_comment(line):
            self._comment = (number, line) if line.strip() else self._comment
            return None
        at, comment = self._comment
        if _names_columns(comment, line):
            return FoundHeader(at, comment.replace("#", " ", 1), on_row=True)  # positions in the line stay
        return FoundHeader(number, line, on_row=line.lstrip().startswith("{"))


def lines_from_header(numbered: Iterable[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """The header, then the lines behind it, without blank lines and comments."""
    search = HeaderSearch()
    lines = iter(numbered)
    for number, line in lines:
        if header := search.take(number, line):
            yield header.number, header.text
            if header.number < number:
                yield number, line
            break
    for number, line in lines:
        if line[:1] in _BEGINS or not is_comment(line):
            yield number, line


def _names_columns(comment: str, line: str) -> bool:
    """True for a comment with as many cells as a line of numbers."""
    cells = line.split(",")
    if not comment.lstrip().startswith("#") or comment.count(",") != len(cells) - 1:
        return False
    try:
        [float(cell) for cell in cells]
    except ValueError:
        return False
    return True
