"""Rows of CSV or NDJSON in and results out, as they come: for `fk` and `ik` in blocks, for `shape` singly."""

from __future__ import annotations

import json
import sys
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from itertools import chain
from typing import Any, Generic, TextIO, TypeAlias, TypeVar

import click
import numpy as np

from contid.errors import BadInputError, Located
from contid.kinematics.array import Array
from contid.robot_file.load import LoadedFile
from contid.trajectory.columns import RobotColumns
from contid.trajectory.lines import HeaderSearch
from contid.trajectory.rows import RowReader
from contid_paths.row_blocks import RowBlock, blocks_of, joined, line_blocks

#: Columns of a result: numbers ``(rows, columns)``, or a tuple of other values for each row.
CellBlock: TypeAlias = Array | Sequence[tuple[bool | int | str, ...]]
Answers = TypeVar("Answers")


class RobotRows(ABC, Generic[Answers]):
    """What is done with the rows of one robot; ``columns`` are its places in a row of SI numbers."""

    @abstractmethod
    def names(self, columns: RobotColumns) -> list[str]:
        """Columns of the result, without the robot's name in front."""

    @abstractmethod
    def solve(self, columns: RobotColumns, rows: Array) -> Answers:
        """The arithmetic; in a thread, while the block before is printed.

        Raises:
            ValueError: a row the model does not take.
        """

    @abstractmethod
    def cells(self, columns: RobotColumns, rows: Array, answers: Answers) -> list[CellBlock]:
        """The columns of the result."""

    def refused(self, answers: Answers) -> tuple[int, str] | None:
        """The first row that ends the conversion, and why."""
        return None


def convert_rows(
    loaded: LoadedFile, path: str | None, robots: Mapping[str, RobotRows[Any]], as_json: bool
) -> None:
    """Print a result for each row of a file, or of stdin for None; ``t_s`` is passed through.

    Args:
        loaded: the robot file.
        path: path of the rows.
        robots: what is done with the rows of each robot.
        as_json: objects instead of CSV.

    Raises:
        BadInputError: at the first wrong row; the results of the rows before it are printed.
    """
    conversion: _Conversion | None = None
    search = HeaderSearch()
    with open_rows(path) as source:
        name = name_of(source)
        for number, lines in line_blocks(source):
            rows = lines
            for k, line in enumerate(lines if conversion is None else ()):
                if header := search.take(number + k, line):
                    reader = RowReader(header.text, name, loaded.file.robots, header.number)
                    conversion = _Conversion(loaded, reader, robots, as_json)
                    rows = lines[k if header.on_row else k + 1 :]
                    break
            if conversion is not None:
                conversion.take(number + len(lines) - len(rows), rows)
    if conversion is None:
        raise no_rows(name)


class _Conversion:
    """Rows after their header, solved and printed in blocks."""

    def __init__(
        self, loaded: LoadedFile, reader: RowReader, robots: Mapping[str, RobotRows[Any]], as_json: bool
    ) -> None:
        self._reader, self._as_json = reader, as_json
        self._robots = [(robots[columns.robot], columns) for columns in reader.layout.robots]
        self._time = [] if reader.layout.time is None else [reader.layout.time]
        self._names = ["t_s" for _ in self._time]
        for robot, columns in self._robots:
            prefix = "" if len(loaded.file.robots) == 1 else f"{columns.robot}."
            self._names += [f"{prefix}{name}" for name in robot.names(columns)]
        self._needs_header = not as_json

    def take(self, number: int, lines: Sequence[str]) -> None:
        """Convert and print lines of which the first has this number."""
        with ThreadPoolExecutor(1) as solver:
            waiting: tuple[RowBlock, Future[list[Any]]] | None = None
            for block in blocks_of(self._reader, number, lines):
                now = block, solver.submit(self._solve, block.rows)
                if waiting is not None:
                    self._print(*waiting)
                waiting = now
            if waiting is not None:
                self._print(*waiting)

    def _solve(self, rows: Array) -> list[Any]:
        """The answers of each robot."""
        return [robot.solve(columns, rows) for robot, columns in self._robots] if len(rows) else []

    def _print(self, block: RowBlock, solved: Future[list[Any]]) -> None:
        try:
            answers = solved.result()
        except ValueError:  # a row the model does not take: find it
            for place, row in zip(block.places, block.rows, strict=True):
                with located_at(Located(self._reader.name, place, 1, "")):
                    answers = self._solve(row[None])
                self._print_rows([place], row[None], answers)
        else:
            if block.places:
                self._print_rows(block.places, block.rows, answers)
        if block.mistake is not None:
            raise block.mistake

    def _print_rows(self, places: Sequence[int], rows: Array, answers: Sequence[Any]) -> None:
        end, message = len(rows), ""
        parts: list[CellBlock] = [rows[:, self._time]] if self._time else []
        for (robot, columns), found in zip(self._robots, answers, strict=True):
            parts += robot.cells(columns, rows, found)
            if (refused := robot.refused(found)) and refused[0] < end:
                end, message = refused
        lines = (self._objects(parts) if self._as_json else _csv(parts))[:end]
        if lines and self._needs_header:
            lines.insert(0, ",".join(self._names))
            self._needs_header = False
        if lines:
            click.echo("\n".join(lines))
        if message:
            raise BadInputError([Located(self._reader.name, places[end], 1, message)])

    def _objects(self, parts: Sequence[CellBlock]) -> list[str]:
        rows = zip(*(part.tolist() if isinstance(part, np.ndarray) else part for part in parts), strict=True)
        cells = (chain.from_iterable(row) for row in rows)
        return [json.dumps(dict(zip(self._names, row, strict=True))) for row in cells]


def _csv(parts: Sequence[CellBlock]) -> list[str]:
    texts = [joined(part) if isinstance(part, np.ndarray) else list(map(_text, part)) for part in parts]
    return list(map(",".join, zip(*texts, strict=True)))


@lru_cache(maxsize=4096)
def _text(cells: tuple[bool | int | str, ...]) -> str:
    return ",".join(str(cell).lower() if isinstance(cell, bool) else str(cell) for cell in cells)


def name_of(source: TextIO) -> str:
    """The name of rows in messages."""
    return "stdin" if source is sys.stdin else str(source.name)


def no_rows(name: str) -> BadInputError:
    """The error for an input without rows."""
    return BadInputError([Located(name, 1, 1, "no rows: the first line is a header such as x_mm,y_mm")])


@contextmanager
def located_at(place: Located) -> Iterator[None]:
    """Turn a ValueError into a finding of this row."""
    try:
        yield
    except ValueError as error:
        raise BadInputError([replace(place, message=str(error))]) from error


def open_rows(path: str | None) -> TextIO:
    """The named file, or stdin; a terminal on stdin is a usage error."""
    if path is not None and path != "-":
        return click.open_file(path, encoding="utf-8", errors="replace")  # type: ignore[return-value]  # text mode
    if sys.stdin.isatty():
        raise click.UsageError("give rows on stdin or name a file, or pipe them in")
    return sys.stdin
