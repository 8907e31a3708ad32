"""Points and rows as a person writes them, for `contid move`; the daemon checks what they mean."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence

from contid.errors import BadInputError, ContidError, Located


def point(message: Sequence[str]) -> dict[str, float]:
    """A target from ``[ROBOT] COLUMN=VALUE ...``.

    Raises:
        ContidError: a word is neither, or a value is no number.
    """
    robot = ""
    target: dict[str, float] = {}
    for place, word in enumerate(message):
        column, equals, value = word.partition("=")
        if not equals and place == 0:
            robot = f"{word}."
            continue
        try:
            target[f"{robot}{column}"] = float(value)
        except ValueError:
            raise ContidError(f"{word!r}: COLUMN=VALUE with a number is expected, such as x_mm=40") from None
    if not target:
        raise ContidError("no COLUMN=VALUE; for example x_mm=40 y_mm=75")
    return target


def columns_and_rows(file: Iterable[str]) -> tuple[list[str], Iterator[list[float]]]:
    """Columns and rows of a CSV; rows are read as they are asked for.

    Raises:
        ContidError: there is no header.
        BadInputError: from the iterator, for a cell that is no number.
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
