"""Points and rows of `contid move`: text to numbers; the daemon checks their meaning."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence

from contid.errors import BadInputError, ContidError, Located


def point(arguments: Sequence[str]) -> dict[str, float]:
    """A target from ``[ROBOT] COLUMN=VALUE ...``.

    Raises:
        ContidError: an argument has neither form, or a value is not a number.
    """
    robot = ""
    target: dict[str, float] = {}
    for position, argument in enumerate(arguments):
        column, equals, value = argument.partition("=")
        if not equals and position == 0:
            robot = f"{argument}."
            continue
        try:
            target[f"{robot}{column}"] = float(value)
        except ValueError:
            message = f"{argument!r}: COLUMN=VALUE with a number is expected, such as x_mm=40"
            raise ContidError(message) from None
    if not target:
        raise ContidError("no COLUMN=VALUE; for example x_mm=40 y_mm=75")
    return target


def columns_and_rows(file: Iterable[str]) -> tuple[list[str], Iterator[list[float]]]:
    """Columns and rows of a CSV; the rows are read lazily.

    Raises:
        ContidError: there is no header.
        BadInputError: from the iterator, for a cell that is not a number.
    """
    lines = (
        (number, line.strip())
        for number, line in enumerate(file, 1)
        if line.strip() and not line.lstrip().startswith("#")
    )
    first = next(lines, None)
    if first is None:
        raise ContidError("the trajectory is empty: a header and at least one row are needed")
    columns = [name.strip().strip('"') for name in first[1].removeprefix("\ufeff").split(",")]
    return columns, itertools.starmap(lambda number, line: _row(number, line, columns), lines)


def _row(number: int, line: str, columns: Sequence[str]) -> list[float]:
    cells = line.split(",")
    if len(cells) != len(columns):
        message = f"the row has {len(cells)} values, the header {len(columns)} columns"
        raise BadInputError([Located("trajectory", number, 1, message)])
    row = []
    for name, cell in zip(columns, cells, strict=True):
        try:
            row.append(float(cell))
        except ValueError:
            message = f"{name}: {cell.strip()[:40]!r} is not a number"
            raise BadInputError([Located("trajectory", number, 1, message)]) from None
    return row
