"""Lines to cells, and cells to numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from contid_adapt.reading.table import LOST

#: Doubles have every integer up to this one.
EXACT: Final = 2**53
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?")
_SPECIAL: Final = re.compile(r'["(\[{]')
_IN_LIST: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan|NaN|null|None")
_LIST: Final = re.compile(r"^(?:array)?[(\[].*[)\]]$|^\{.*\}$", re.DOTALL)
_OPEN: Final = {"(": ")", "[": "]", "{": "}"}


def begins(line: str, separator: str) -> list[int]:
    """Where the cells of a line begin, from 1, blanks in front left out."""
    places, place = [], 0
    for cell in split(line, separator, strip=False):
        at = line.find(cell, place) if separator == " " else place
        places.append(max(at, 0) + len(cell) - len(cell.lstrip()) + 1)
        place = max(at, 0) + len(cell) + (separator != " ")
    return places or [1]


def split(line: str, separator: str, strip: bool = True) -> list[str]:
    """The cells of a line; separators inside quotes and brackets separate nothing."""
    if not _SPECIAL.search(line):
        if separator == " ":
            return line.split()
        return line.split(separator)
    cells: list[str] = []
    begin, quoted, closing = 0, False, ""
    for at, letter in enumerate(line):
        if letter == '"':
            quoted = not quoted
        elif quoted:
            continue
        elif closing:
            if letter == closing[-1]:
                closing = closing[:-1]
            elif letter in _OPEN:
                closing += _OPEN[letter]
        elif letter in _OPEN and not line[begin:at].strip():
            closing += _OPEN[letter]
        elif letter == separator or (separator == " " and letter.isspace()):
            cells.append(line[begin:at])
            begin = at + 1
    cells.append(line[begin:])
    if separator == " ":
        cells = [cell for cell in cells if cell.strip()]
    return [unquoted(cell) for cell in cells] if strip else cells


def unquoted(cell: str) -> str:
    """A cell without blanks around it and its quotes."""
    cell = cell.strip()
    if len(cell) > 1 and cell[0] == cell[-1] == '"':
        return cell[1:-1].replace('""', '"').strip()
    return cell


def number(cell: str, decimal: str = ".") -> float | None:
    """A finite number, NaN where the sample was lost, or None."""
    cell = cell.strip()
    if decimal != ".":
        if "." in cell:
            return None  # A separator of thousands, or the other decimal sign.
        cell = cell.replace(decimal, ".", 1)
    if _NUMBER.fullmatch(cell):
        value = float(cell.replace("d", "e").replace("D", "e"))
        return value if math.isfinite(value) else None
    return math.nan if is_lost(cell) else None


def is_lost(cell: str) -> bool:
    """True for what cells hold where a sample was lost."""
    return cell.strip().lower() in LOST


def is_number(cell: str, decimal: str = ".") -> bool:
    """True for a number or a list of numbers; not for a lost sample."""
    value = number(cell, decimal)
    return (value is not None and not math.isnan(value)) or (bool(_LIST.match(cell)) and is_list(cell))


def is_list(cell: str) -> bool:
    """True for ``[1, 2]``, ``(1, 2)``, ``[1 2]``, ``{"x": 1}``."""
    return bool(_LIST.match(cell) and _IN_LIST.search(cell))


def listed(cell: str) -> list[tuple[str, float]] | None:
    """The numbers in a cell with the ends of their names: ``[0]``, ``[1]``, or ``.x``; None for none."""
    if cell.startswith("{"):
        from contid_adapt.reading.objects import flat, parsed

        value = parsed(cell.replace("'", '"'))
        if not isinstance(value, dict):
            return None
        pairs = [(f".{name}", each) for name, each in flat(value)]
        return [(name, float(each)) for name, each in pairs if isinstance(each, int | float)]
    inner = cell[5:] if cell.startswith("array") else cell
    inner = inner.strip()[1:-1]
    if re.sub(r"[\s,;\[\]()]", "", _IN_LIST.sub("", inner)):
        return None
    values = [float(each) if each[0] not in "nN" else math.nan for each in _IN_LIST.findall(inner)]
    return [(f"[{place}]", each) for place, each in enumerate(values)]


def numbers(cells: Sequence[str], decimal: str, first_row: int) -> tuple[NDArray[Any], list[tuple[int, str]]]:
    """A column of cells as numbers, and the rows and cells that are none (they become NaN)."""
    if decimal == ".":
        try:
            values = np.array(list(map(float, cells)))
        except ValueError:
            values = None
        if values is not None and np.isfinite(values).all() and "_" not in "".join(cells):
            # A number of more digits than a double has: an integer keeps them all.
            if len(values) and np.abs(values).max() > EXACT:
                whole = _integers(cells)
                return (values if whole is None else whole), []
            return values, []
    found, bad = np.empty(len(cells)), []
    for row, cell in enumerate(cells):
        value = number(unquoted(cell) if '"' in cell else cell, decimal)
        if value is None:
            bad.append((first_row + row, cell.strip()))
        found[row] = math.nan if value is None else value
    return found, bad


def _integers(cells: Sequence[str]) -> NDArray[np.int64] | None:
    try:
        return np.array([int(cell) for cell in cells], dtype=np.int64)
    except (ValueError, OverflowError):
        return None
