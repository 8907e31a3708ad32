"""Tables written as JSON: one object per line, a list of objects, or an object of lists."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from contid.errors import BadInputError, Located
from contid_adapt.reading.cells import EXACT
from contid_adapt.reading.table import Table, TableColumn

_MAX_DEPTH: Final = 8


def parsed(text: str) -> Any:
    """JSON, or None where it is none."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def flat(value: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Every number and word in nested objects and lists with its name: ``pose.position.x``, ``state[0]``."""
    if isinstance(value, dict) and depth < _MAX_DEPTH:
        for key, each in value.items():
            yield from flat(each, f"{name}.{key}" if name else str(key), depth + 1)
    elif isinstance(value, list) and depth < _MAX_DEPTH:
        for place, each in enumerate(value):
            yield from flat(each, f"{name}[{place}]", depth + 1)
    else:
        yield name, value


def read_objects(lines: Sequence[str], file: str) -> Table | None:
    """A table of JSON, or None where the text is none.

    The line of a row is that of its object where each has a line, else the number of the row.

    Raises:
        BadInputError: a line is no object, or has other keys than the first.
    """
    head = next((line.lstrip()[:1] for line in lines if line.strip()), "")
    if head not in ("{", "["):
        return None
    rows: list[tuple[int, dict[str, Any]]] = []
    whole = parsed("\n".join(lines))
    if whole is None or (isinstance(whole, dict) and len([line for line in lines if line.strip()]) == 1):
        if head == "[":
            return None
        for index, line in enumerate(lines):
            if line.strip():
                value = parsed(line)
                if not isinstance(value, dict):
                    raise BadInputError([Located(file, index + 1, 1, "not JSON: one object per line")])
                rows.append((index + 1, dict(flat(value))))
        if whole is not None and any(isinstance(each, list) for each in whole.values()):
            return _of_lists(whole, file) or _of_rows(rows, file)
    elif isinstance(whole, list):
        rows = [(place + 1, dict(flat(each))) for place, each in enumerate(whole)]
    else:
        table = _of_lists(whole, file)
        if table is not None:
            return table
        inner = [each for each in whole.values() if isinstance(each, list) and each]
        if len(inner) != 1 or not isinstance(inner[0][0], dict):
            raise BadInputError([Located(file, 1, 1, "JSON, but no table: no list of objects or of numbers")])
        rows = [(place + 1, dict(flat(each))) for place, each in enumerate(inner[0])]
    return _of_rows(rows, file)


def _of_lists(whole: dict[str, Any], file: str) -> Table | None:
    """An object of lists, or of objects with the same keys, which are the rows (pandas)."""
    objects = [each for each in whole.values() if isinstance(each, dict)]
    if any(each.keys() != objects[0].keys() for each in objects):
        return None
    columns = {
        name: [each[key] for key in objects[0]] if isinstance(each, dict) else each
        for name, each in whole.items()
        if isinstance(each, list | dict)
    }
    sizes = {len(each) for each in columns.values()}
    if len(columns) < 2 or len(sizes) != 1 or not (count := sizes.pop()) or count < 2:
        return None
    rows = [
        (row + 1, dict(flat({name: each[row] for name, each in columns.items()}))) for row in range(count)
    ]
    return _of_rows(rows, file)


def _of_rows(rows: Sequence[tuple[int, dict[str, Any]]], file: str) -> Table:
    if not rows:
        raise BadInputError([Located(file, 1, 1, "no rows")])
    names = list(rows[0][1])
    for line, row in rows:
        if [*row] != names and {*row} != {*names}:
            odd = next(iter({*row} ^ {*names}))
            raise BadInputError([Located(file, line, 1, f"{odd!r} is not in every row; it must be")])
    columns = []
    for place, name in enumerate(names):
        columns.append(column_of(name, place + 1, [row[name] for _, row in rows]))
    at = np.array([line for line, _ in rows], dtype=np.int64)
    return Table(file, tuple(columns), at, np.ones(len(rows), np.int64), (), names_line=rows[0][0])


def column_of(name: str, position: int, values: Sequence[Any]) -> TableColumn:
    """A column of JSON values: of texts where these are more than half, else of numbers.

    Args:
        name: of the column.
        position: of the column, from 1.
        values: of the rows; None where a sample was lost.
    """
    from contid_adapt.meaning.units import unit_of_name

    texts = sum(isinstance(each, str) for each in values)
    if 2 * texts > len(values):
        return TableColumn(name, position, np.array([str(each) for each in values], dtype=object))
    bad, found = [], np.empty(len(values))
    for row, each in enumerate(values):
        right = isinstance(each, int | float) or each is None
        found[row] = _double(each) if right and each is not None else math.nan
        if not right or math.isinf(found[row]):
            bad.append((row, str(each)))
    whole = all(isinstance(each, int) and abs(each) < 2**62 for each in values)
    if whole and len(values) and np.abs(found).max() > EXACT:
        return TableColumn(name, position, np.array(values, dtype=np.int64), unit_of_name(name))
    return TableColumn(name, position, found, unit_of_name(name), tuple(bad))


def _double(value: float) -> float:
    try:
        return float(value)
    except OverflowError:  # JSON bounds no integer
        return math.inf
