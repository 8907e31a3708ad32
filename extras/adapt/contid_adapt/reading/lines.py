"""The lines of a text, kept as its bytes: a line becomes a string when it is asked for."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final, overload

import numpy as np

#: Lines that are decoded at a time by an iteration.
_BLOCK: Final = 20_000
#: A quote that begins a cell and is not closed, and how many lines such a cell may go over.
_OPENS: Final = re.compile(r'(^|[,;\t|])\s*"[^"]*$')
_MOST_LINES: Final = 3
#: Signs of lines that hold nothing, at the end of a file.
_BLANK: Final = " \t,;|\r\x1a\0"


class TextLines(Sequence[str]):
    """The lines of a text in UTF-8, with LF between them.

    A million lines of 25 characters are 26 MB of bytes and 8 MB of places, and 83 MB as strings.
    """

    def __init__(self, data: bytes) -> None:
        """Find the lines.

        Args:
            data: the text in UTF-8.
        """
        self._data = data
        ends = np.flatnonzero(np.frombuffer(data, np.uint8) == ord("\n"))
        #: Where each line begins, and where one behind the last would.
        self._begins = np.concatenate([[0], ends + 1, [len(data) + 1]])
        self._count = len(ends) + 1
        #: Lines that are other than in the bytes.
        self._replaced: dict[int, str] = {}

    def __len__(self) -> int:
        """Number of lines."""
        return self._count

    @overload
    def __getitem__(self, place: int) -> str: ...
    @overload
    def __getitem__(self, place: slice) -> list[str]: ...
    def __getitem__(self, place: int | slice) -> str | list[str]:
        """A line, or the lines of a slice, from 0 and without their ends."""
        if isinstance(place, slice):
            begin, end, step = place.indices(self._count)
            if step != 1:
                return [self[index] for index in range(begin, end, step)]
            return self._lines(begin, end) if begin < end else []
        if not -self._count <= place < self._count:
            raise IndexError(place)
        return self._lines(place % self._count, place % self._count + 1)[0]

    def __iter__(self) -> Iterator[str]:
        """Every line, in blocks."""
        for begin in range(0, self._count, _BLOCK):
            yield from self._lines(begin, min(begin + _BLOCK, self._count))

    def _lines(self, begin: int, end: int) -> list[str]:
        lines = self._data[self._begins[begin] : self._begins[end] - 1].decode().split("\n")
        if self._replaced:
            for place in range(begin, end):
                lines[place - begin] = self._replaced.get(place, lines[place - begin])
        return lines

    def join_quoted(self) -> None:
        """Put a quoted cell that goes over the ends of lines into one line; the others stay, empty."""
        begin = -1
        for index, line in enumerate(self):
            if begin < 0:
                begin = index if line.count('"') % 2 and _OPENS.search(line) else -1
            elif index - begin > _MOST_LINES:
                begin = -1
            elif line.count('"') % 2:
                joined = " ".join(self[begin : index + 1])
                self._replaced |= dict.fromkeys(range(begin + 1, index + 1), "")
                self._replaced[begin] = joined
                begin = -1

    def drop_blank_end(self) -> None:
        """Leave out the lines at the end that hold nothing but separators; one line stays."""
        while self._count > 1 and not self[self._count - 1].strip(_BLANK):
            self._count -= 1


def lines_of(data: bytes) -> TextLines:
    r"""The lines of a text in UTF-8: ends are LF, CR LF, CR CR LF, or CR where there is nothing else."""
    if b"\r" in data:
        data = data.replace(b"\r\r\n", b"\n").replace(b"\r\n", b"\n")
        if b"\n" not in data:
            data = data.replace(b"\r", b"\n")
    lines = TextLines(data)
    if data.startswith(b"|") and sum(line.startswith("|") for line in lines) * 2 > len(lines):
        lines = TextLines("\n".join(map(_without_bars, lines)).encode())
    if b'"' in data:
        lines.join_quoted()
    lines.drop_blank_end()
    return lines


def _without_bars(line: str) -> str:
    """A line of a table of Markdown or of a database: blanks in place of the outer bars keep positions."""
    return "" if not line.strip("|-+: ") else " " + line[1:].rstrip().removesuffix("|")
