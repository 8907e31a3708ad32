"""Rows of CSV or NDJSON in blocks, read together where they are plain, with the same result as row by row.

A block is what has arrived: rows typed into a pipe are answered at once, a file in blocks of thousands.
Whatever is unusual in a block (comments, quotes, mistakes) sends it through the reader of single rows.
"""

from __future__ import annotations

import codecs
import io
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple, TextIO

import numpy as np

from contid.errors import BadInputError
from contid.kernels import load
from contid.kinematics.array import Array
from contid.trajectory.columns import ColumnLayout
from contid.trajectory.lines import is_comment
from contid.trajectory.rows import MAX_NUMBER, RowReader
from contid.units import MAX_LINE

#: Rows solved together: while one block is solved, the one before is printed.
ROWS: Final = 4096
_BYTES: Final = 1 << 20


class RowBlock(NamedTuple):
    """Rows that are solved and printed together.

    Attributes:
        places: numbers of their lines.
        rows: SI numbers, shape ``(rows, columns)``.
        mistake: what is wrong in the line after them.
    """

    places: Sequence[int]
    rows: Array
    mistake: BadInputError | None = None


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


def blocks_of(reader: RowReader, number: int, lines: Sequence[str]) -> Iterator[RowBlock]:
    """The rows of lines, the first of which has this number, up to the first mistake."""
    for first in range(0, len(lines), ROWS):
        part = lines[first : first + ROWS]
        rows = None if reader.is_json else numbers(reader.layout, part)
        if rows is not None:
            yield RowBlock(range(number + first, number + first + len(part)), rows)
            continue
        block = _one_by_one(reader, number + first, part)
        if block.places or block.mistake:
            yield block
        if block.mistake is not None:
            return


def _one_by_one(reader: RowReader, number: int, lines: Sequence[str]) -> RowBlock:
    places: list[int] = []
    rows: list[list[float]] = []
    mistake = None
    for place, line in enumerate(lines, number):
        if is_comment(line):
            continue
        try:
            rows.append(reader.row(line, place))
        except BadInputError as error:
            mistake = error
            break
        places.append(place)
    return RowBlock(places, np.reshape(rows, (len(rows), len(reader.columns))), mistake)


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
        if robot.arcs:
            return None
        if robot.direction and not rows[:, robot.direction].any(axis=1).all():
            return None
        if robot.x_axis and any(robot.rotation(row) is None for row in rows.tolist()):
            return None
    return rows


def joined(values: Array) -> list[str]:
    """A line of comma-separated numbers per row, each as ``repr`` writes it."""
    lines: list[str] = load("text").joined(np.ascontiguousarray(values))
    return lines
