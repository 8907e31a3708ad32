"""Points and rows of `contid move`: text to numbers; the daemon checks their meaning."""

from __future__ import annotations

import math
import os
import re
import stat
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Self, TextIO

from contid.errors import BadInputError, ContidError, Located
from contid.remote.client.described_robot import columns_of
from contid.trajectory.lines import CUT, NO_TIMES


def point(arguments: Sequence[str]) -> dict[str, float]:
    """A target from ``[ROBOT] COLUMN=VALUE ...``.

    Raises:
        ContidError: an argument has neither form, a value is not a finite number, or a column comes twice.
    """
    robot = ""
    target: dict[str, float] = {}
    for position, argument in enumerate(arguments):
        column, equals, value = argument.partition("=")
        if not equals and position == 0:
            robot = f"{argument}."
            continue
        if f"{robot}{column}" in target:
            raise ContidError(f"{argument!r}: {column} is given twice")
        try:
            target[f"{robot}{column}"] = _finite(value)
        except ValueError:
            message = f"{argument!r}: COLUMN=VALUE with a finite number is expected, such as x_mm=40"
            raise ContidError(message) from None
    if not target:
        raise ContidError("no COLUMN=VALUE; for example x_mm=40 y_mm=75")
    return target


def with_other_axes(
    target: Mapping[str, float], describe: Mapping[str, Any], status: Mapping[str, Any]
) -> dict[str, float]:
    """A target of some axes of a robot with the commands of its others, which stay where they are.

    Args:
        target: value by column.
        describe: of the daemon.
        status: of the daemon.
    """
    found, robots = dict(target), columns_of(describe)
    for name, robot in robots.items():
        known = describe["robots"][name]["columns"]
        mine = {each for each in target if each.startswith(f"{name}.")}
        mine |= {each for each in target if len(robots) == 1 and each in known}
        own = {each.removeprefix(f"{name}."): each for each in mine}
        axes = [each.removeprefix(f"{name}.") for each in robot.axes]
        if not own or not own.keys() < set(axes):
            continue
        prefix = next(iter(own.values())).removesuffix(next(iter(own)))
        at = status["robots"][name].get("axes", {})
        for column, unit, values in zip(axes, robot.units, at.values(), strict=False):
            command = values[f"command_{unit}"]
            if column not in own and command is not None:
                found[f"{prefix}{column}"] = command
    return found


class CsvRows:
    """The rows of a CSV, read lazily, and their lines.

    Iterating raises a BadInputError with its place for a cell that is not a finite number, and where there is
    no row.
    """

    def __init__(self, name: str, columns: Sequence[str], numbered: Iterator[tuple[int, str]]) -> None:
        self.name, self._columns, self._numbered = name, columns, numbered
        self._timed = "t_s" in columns
        self._lines = array("q")

    def __iter__(self) -> Self:
        """Itself."""
        return self

    def __next__(self) -> list[float]:
        """The next row."""
        number, line = next(self._numbered, (0, ""))
        if not number and not self._lines:
            raise BadInputError([Located(self.name, 1, 1, "no rows after the header")])
        if not number:
            raise StopIteration
        self._lines.append(number)
        live = self.name == "stdin" and not self._timed
        return _row(Located(self.name, number, 1, ""), line, self._columns, live)

    def located(self, message: str) -> str:
        """A message of a daemon, which counts the rows that it got, with the file and its lines.

        It has ``rows:5``, and of a trajectory ``on line 5``, whose header it counts as line 1.
        """

        def line_of(number: str) -> str:
            index = int(number) - (2 if self._timed else 1)
            return str(self._lines[index]) if 0 <= index < len(self._lines) else number

        message = re.sub(r"(?m)^rows:(\d+)", lambda found: f"{self.name}:{line_of(found[1])}", message)
        return re.sub(r"\bon line (\d+)", lambda found: f"on line {line_of(found[1])}", message)


def columns_and_rows(file: Iterable[str]) -> tuple[list[str], CsvRows]:
    """Columns and rows of a CSV.

    Raises:
        ContidError: there is no header.
    """
    name = str(getattr(file, "name", "trajectory")).strip("<>")  # <stdin>
    lines = (
        (number, line)
        for number, line in enumerate(file, 1)
        if line.strip() and not line.lstrip().startswith("#")
    )
    first = next(lines, None)
    if first is None:
        raise ContidError(f"{name}: empty: a header and at least one row are needed")
    columns = [column.strip().strip('"') for column in first[1].removeprefix("\ufeff").split(",")]
    return columns, CsvRows(name, columns, lines)


def rows_to_send(file: TextIO) -> tuple[list[str], CsvRows]:
    """As `columns_and_rows`; rows of a file have times, those of a pipe or a terminal may have none.

    Raises:
        ContidError: there is no header, or a file has no times.
    """
    columns, rows = columns_and_rows(file)
    # A header that is no text is refused by the daemon, with the reason.
    if "t_s" not in columns and "".join(columns).isprintable() and _is_file(file):
        raise BadInputError([Located(rows.name, 1, 1, NO_TIMES)])
    return columns, rows


def _is_file(rows: TextIO) -> bool:
    try:
        return stat.S_ISREG(os.fstat(rows.fileno()).st_mode)
    except OSError:  # it has no number, as text in memory
        return False


def _row(place: Located, line: str, columns: Sequence[str], live: bool) -> list[float]:
    if live and not line.endswith("\n"):
        raise BadInputError([replace(place, message=CUT)])
    cells = line.rstrip().split(",")
    if len(cells) != len(columns):
        message = f"the row has {len(cells)} values, the header {len(columns)} columns"
        raise BadInputError([replace(place, message=message)])
    row: list[float] = []
    for name, cell in zip(columns, cells, strict=True):
        try:
            row.append(_finite(cell))
        except ValueError:
            column = sum(len(before) + 1 for before in cells[: len(row)]) + 1
            message = f"{name}: {cell.strip()[:40]!r} is not a finite number"
            raise BadInputError([replace(place, column=column, message=message)]) from None
    return row


def _finite(text: str) -> float:
    """The number of a text; a ValueError for infinity and NaN too, which JSON lacks."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError
    return number
