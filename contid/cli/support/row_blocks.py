"""Rows of CSV in blocks: parsed, solved and printed together, with the same results as row by row.

A block is what has arrived: rows typed into a pipe are answered at once, a file in blocks of thousands.
Whatever is unusual in a block (comments, quotes, mistakes) sends it through the reader of single rows.
"""

from __future__ import annotations

import codecs
import io
import math
from collections.abc import Iterator, Sequence
from typing import Final, Protocol, TextIO

import numpy as np

from contid.kinematics.array import Array
from contid.lines import MAX_LINE
from contid.trajectory.columns import ColumnLayout
from contid.trajectory.rows import MAX_NUMBER

#: Rows solved together: while one block is solved, the one before is printed.
ROWS: Final = 4096
_BYTES: Final = 1 << 20


class ManyRows(Protocol):
    """A conversion of blocks."""

    def header(self, layout: ColumnLayout) -> tuple[str, ...] | None:
        """Columns of the result; None when rows with this layout are converted one by one."""
        ...

    def solve(self, layout: ColumnLayout, rows: Array) -> object:
        """The arithmetic, for rows of SI numbers; in a thread of its own.

        Raises:
            ValueError: a row the model does not take.
        """
        ...

    def lines(self, solved: object) -> tuple[list[str], str]:
        """Lines of CSV, and a message when the row after the last line ends the conversion."""
        ...


def line_blocks(source: TextIO) -> Iterator[tuple[int, list[str]]]:
    """Number of the first line, and the complete lines that have arrived, without their ends."""
    decoder = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder("utf-8")("replace"), translate=True)
    stream = source.buffer
    number, rest = 1, ""
    while data := stream.read1(_BYTES):  # type: ignore[attr-defined]  # buffered, also when it is a pipe
        *lines, rest = (rest + decoder.decode(data)).split("\n")
        rest = rest[: MAX_LINE + 1]
        yield from _numbered(number, lines)
        number += len(lines)
    *lines, rest = (rest + decoder.decode(b"", final=True)).split("\n")
    yield from _numbered(number, [*lines, rest] if rest else lines)


def _numbered(number: int, lines: list[str]) -> Iterator[tuple[int, list[str]]]:
    if number == 1 and lines:
        lines[0] = lines[0].removeprefix("\ufeff")
    if lines:
        yield number, lines


def numbers(layout: ColumnLayout, lines: Sequence[str]) -> Array | None:
    """Lines as SI numbers ``(lines, columns)``; None unless every line is a plain row without a mistake."""
    columns = len(layout.names)
    text = ",".join(lines)
    if "_" in text or '"' in text or max(map(len, lines)) > MAX_LINE:
        return None
    if {line.count(",") for line in lines} != {columns - 1}:
        return None
    try:
        values = np.array(list(map(float, text.split(",")))).reshape(len(lines), columns)
    except ValueError:
        return None
    if not np.abs(values).max() <= MAX_NUMBER:  # NaN included
        return None
    rows: Array = values * layout.factors / layout.divisors
    for robot in layout.robots:
        if robot.direction and not rows[:, robot.direction].any(axis=1).all():
            return None
        if robot.x_axis and any(robot.rotation(row) is None for row in rows.tolist()):
            return None
    return rows


def vectors(rows: Array, columns: tuple[int, ...]) -> Array:
    """Vectors ``(rows, 3)``; planar robots leave z at 0."""
    found = np.zeros((len(rows), 3))
    found[:, : len(columns)] = rows[:, columns]
    return found


def unit_vectors(given: Array) -> Array:
    """Vectors with length 1, rounded as those of single rows are."""
    lengths = np.array([math.hypot(*vector) for vector in given.tolist()])
    found: Array = given / lengths[:, None]
    return found


def joined(values: Array) -> list[str]:
    """A line of comma-separated numbers per row, each as ``repr`` writes it."""
    if not len(values):
        return []
    return repr(values.tolist())[2:-2].replace(", ", ",").split("],[")
