"""Shared by ``fk``, ``ik`` and ``shape``: rows of CSV or NDJSON in, one result per row out, as they come."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from typing import TextIO

import click

from contid.cli.support.row_blocks import ROWS, ManyRows, line_blocks, numbers
from contid.errors import BadInputError, Located
from contid.robot_file.load import LoadedFile
from contid.targets import Target
from contid.trajectory.rows import RowReader, is_comment, numbered_lines

Cell = float | int | bool | str
Convert = Callable[[Mapping[str, Target]], dict[str, Cell]]


def convert_rows(
    loaded: LoadedFile, source: TextIO, convert: Convert, as_json: bool, many: ManyRows | None = None
) -> None:
    """Read targets and print the result of ``convert`` for each row; ``t_s`` is passed through.

    Args:
        loaded: the robot file.
        source: of the rows.
        convert: one row.
        as_json: objects instead of CSV.
        many: blocks of rows, for CSV in and out; the same results as ``convert``.

    Raises:
        BadInputError: at the first wrong row; the results of the rows before it are printed.
    """
    if as_json or many is None:
        header: tuple[str, ...] | None = None
        for cells in _results(loaded, source, convert):
            if as_json:
                click.echo(json.dumps(cells))
                continue
            if header is None:
                header = tuple(cells)
                click.echo(",".join(header))
            click.echo(_line(cells))
        return
    blocks = _Blocks(loaded, _name(source), convert, many)
    for number, lines in line_blocks(source):
        blocks.take(number, lines)
    blocks.end()


class _Blocks:
    """Rows as they come: plain ones in blocks, the others one by one."""

    def __init__(self, loaded: LoadedFile, name: str, convert: Convert, many: ManyRows) -> None:
        self._loaded, self._name, self._convert, self._many = loaded, name, convert, many
        self._reader: RowReader | None = None
        self._plain = self._printed = False

    def take(self, number: int, lines: list[str]) -> None:
        """Convert and print lines of which the first has this number."""
        begin = 0
        while self._reader is None and begin < len(lines):
            if not is_comment(lines[begin]):
                self._reader = RowReader(lines[begin], self._name, self._loaded.file.robots, number + begin)
                self._plain = not self._reader.is_json and self._many.header(self._reader.layout) is not None
                if self._reader.is_json:
                    break
            begin += 1
        if self._reader is None or begin >= len(lines):
            return
        layout = self._reader.layout
        with ThreadPoolExecutor(1) as solver:
            waiting: tuple[int, list[str], Future[object]] | None = None
            for first in range(begin, len(lines), ROWS):
                part = lines[first : first + ROWS]
                rows = numbers(layout, part) if self._plain else None
                now = None if rows is None else solver.submit(self._many.solve, layout, rows)
                if waiting is not None:
                    self._print(*waiting)
                waiting = None if now is None else (number + first, part, now)
                if rows is None:
                    self._one_by_one(number + first, part)
            if waiting is not None:
                self._print(*waiting)

    def end(self) -> None:
        """After the last line.

        Raises:
            BadInputError: there was no header.
        """
        if self._reader is None:
            raise _no_rows(self._name)

    def _print(self, number: int, part: list[str], solved: Future[object]) -> None:
        assert self._reader is not None
        try:
            lines, message = self._many.lines(solved.result())
        except ValueError:  # a row the model does not take: find it
            self._one_by_one(number, part)
            return
        if lines and not self._printed:
            click.echo(",".join(self._many.header(self._reader.layout) or ()))
            self._printed = True
        if lines:
            click.echo("\n".join(lines))
        if message:
            raise BadInputError([Located(self._name, number + len(lines), 1, message)])

    def _one_by_one(self, number: int, lines: list[str]) -> None:
        assert self._reader is not None
        for place, time_s, targets in _rows_of(self._reader, self._name, enumerate(lines, number)):
            with located_at(place):
                cells = _timed(time_s, self._convert(targets))
            if not self._printed:
                click.echo(",".join(cells))
                self._printed = True
            click.echo(_line(cells))


def read_rows(
    loaded: LoadedFile, source: TextIO
) -> Iterator[tuple[Located, float | None, Mapping[str, Target]]]:
    """Location of each row, its time if it has one, and its targets in the world frame.

    Raises:
        BadInputError: at the first wrong row.
    """
    name = _name(source)
    lines = numbered_lines(source)
    for number, line in lines:
        if is_comment(line):
            continue
        reader = RowReader(line, name, loaded.file.robots, number)
        yield from _rows_of(reader, name, chain([(number, line)], lines) if reader.is_json else lines)
        return
    raise _no_rows(name)


def _rows_of(
    reader: RowReader, name: str, lines: Iterable[tuple[int, str]]
) -> Iterator[tuple[Located, float | None, Mapping[str, Target]]]:
    for number, line in lines:
        if is_comment(line):
            continue
        row = reader.row(line, number)
        time = reader.layout.time
        time_s = None if time is None else row[time]
        yield Located(name, number, 1, ""), time_s, reader.layout.targets(row)


def _name(source: TextIO) -> str:
    return "stdin" if source is sys.stdin else str(source.name)


def _no_rows(name: str) -> BadInputError:
    return BadInputError([Located(name, 1, 1, "no rows: the first line is a header such as x_mm,y_mm")])


def _results(loaded: LoadedFile, source: TextIO, convert: Convert) -> Iterator[dict[str, Cell]]:
    for place, time_s, targets in read_rows(loaded, source):
        with located_at(place):
            cells = convert(targets)
        yield _timed(time_s, cells)


def _timed(time_s: float | None, cells: dict[str, Cell]) -> dict[str, Cell]:
    return cells if time_s is None else {"t_s": time_s, **cells}


def _line(cells: Mapping[str, Cell]) -> str:
    return ",".join(_text(value) for value in cells.values())


@contextmanager
def located_at(place: Located) -> Iterator[None]:
    """Turn a ValueError into a finding of this row."""
    try:
        yield
    except ValueError as error:
        raise BadInputError([replace(place, message=str(error))]) from error


def column_prefix(loaded: LoadedFile, robot: str) -> str:
    """``ROBOT.`` in front of column names; empty when the file has one robot."""
    return "" if len(loaded.file.robots) == 1 else f"{robot}."


def _text(value: Cell) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


def open_rows(path: str | None) -> TextIO:
    """The named file, or stdin; a terminal on stdin is a usage error."""
    if path is not None and path != "-":
        return click.open_file(path, encoding="utf-8", errors="replace")  # type: ignore[return-value]  # text mode
    if sys.stdin.isatty():
        raise click.UsageError("give rows on stdin or name a file, or pipe them in")
    return sys.stdin
