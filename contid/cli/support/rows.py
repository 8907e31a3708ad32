"""Shared by ``fk``, ``ik`` and ``shape``: rows of CSV or NDJSON in, one result per row out, as they come."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import TextIO

import click

from contid.errors import BadInputError, Located
from contid.robot_file.load import LoadedFile
from contid.targets import Target
from contid.trajectory.rows import RowReader, is_comment, numbered_lines

Cell = float | int | bool | str
Convert = Callable[[Mapping[str, Target]], dict[str, Cell]]


def convert_rows(loaded: LoadedFile, source: TextIO, convert: Convert, as_json: bool) -> None:
    """Read targets row by row and print the result of ``convert``; ``t_s`` is passed through.

    Raises:
        BadInputError: at the first wrong row; the results of the rows before it are printed.
    """
    header: tuple[str, ...] | None = None
    for cells in _results(loaded, source, convert):
        if as_json:
            click.echo(json.dumps(cells))
            continue
        if header is None:
            header = tuple(cells)
            click.echo(",".join(header))
        click.echo(",".join(_text(value) for value in cells.values()))


def read_rows(
    loaded: LoadedFile, source: TextIO
) -> Iterator[tuple[Located, float | None, Mapping[str, Target]]]:
    """Location of each row, its time if it has one, and its targets in the world frame.

    Raises:
        BadInputError: at the first wrong row.
    """
    name = "stdin" if source is sys.stdin else str(source.name)
    reader: RowReader | None = None
    for number, line in numbered_lines(source):
        if is_comment(line):
            continue
        if reader is None:
            reader = RowReader(line, name, loaded.file.robots, number)
            if not reader.is_json:
                continue
        row = reader.row(line, number)
        time = reader.layout.time
        time_s = None if time is None else row[time]
        yield Located(name, number, 1, ""), time_s, reader.layout.targets(row)
    if reader is None:
        raise BadInputError([Located(name, 1, 1, "no rows: the first line is a header such as x_mm,y_mm")])


def _results(loaded: LoadedFile, source: TextIO, convert: Convert) -> Iterator[dict[str, Cell]]:
    for place, time_s, targets in read_rows(loaded, source):
        with located_at(place):
            cells = convert(targets)
        yield cells if time_s is None else {"t_s": time_s, **cells}


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
