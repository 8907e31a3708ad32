"""Lines with a label before each number, as sketches of Arduino print them for the serial plotter.

``t:10,x:20.5,y:80.1``, also with blanks or tabs between them and ``=`` for ``:``. The serial monitor puts a
time of day in front: ``10:00:01.250 -> x:20.5 y:80.1``.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Final

import numpy as np

from contid_adapt.meaning.units import name_and_unit, unit_of_name
from contid_adapt.reading.table import Table, TableColumn
from contid_adapt.reading.time_text import times_of_texts

_NUMBER: Final = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan|inf"
_PAIR: Final = rf"[A-Za-z_][\w \[\]().°/]*?\s*[:=]\s*(?:{_NUMBER})"
_LINE: Final = re.compile(
    rf"\s*(?:(?P<clock>\d\d:\d\d:\d\d\.\d+) -> ?)?(?P<pairs>{_PAIR}(?:[,;\s]+{_PAIR})*)[,;\s]*"
)
_PARTS: Final = re.compile(rf"([A-Za-z_][\w \[\]().°/]*?)\s*[:=]\s*({_NUMBER})")
#: Lines that are looked at to decide.
_SAMPLE: Final = 20
#: Part of the lines behind the first that may be anything else, such as messages of a sketch.
_OTHERS: Final = 0.02


def labelled_table(lines: Sequence[str], file: str) -> Table | None:
    """The table of a text with labels in every line; None for any other.

    Args:
        lines: of the file.
        file: its name in messages.
    """
    head = [line for line in islice(lines, _SAMPLE) if line.strip()]
    labels = [[name for name, _ in pairs] for line in head if (pairs := _pairs(line))]
    if len(labels) < 3 or 2 * len(labels) < len(head):
        return None
    names = max(labels, key=labels.count)
    if labels.count(names) < len(labels) - 1 or len({*names}) < len(names):
        return None
    numbers, kept, clocks = array("d"), array("q"), []
    others: list[int] = []
    for number, line in enumerate(lines, 1):
        pairs = _pairs(line)
        if [name for name, _ in pairs] == names:
            numbers.extend([float(value) for _, value in pairs])
            kept.append(number)
            clocks.append(_clock(line))
        elif line.strip():
            others.append(number)
    if sum(number > kept[0] for number in others) > max(_OTHERS * len(lines), 1):
        return None
    return _built(lines, file, names, numbers, kept, clocks, others)


def _built(
    lines: Sequence[str], file: str, names: Sequence[str], numbers: array[float], kept: array[int],
    clocks: Sequence[str], others: Sequence[int],
) -> Table:  # fmt: skip
    values = np.array(numbers).reshape(len(kept), len(names))
    notes = ["each number has its label in front"]
    if others:
        notes.append(f"{len(others)} lines without these labels were left out, the first is line {others[0]}")
    columns = []
    times = times_of_texts(clocks)
    if times is not None and not times.bad:
        columns.append(TableColumn("clock", 1, times.values, "ns"))
        notes.append(f"clock: times were read as {times.since}")
    for place, (label, column) in enumerate(zip(names, values.T, strict=True), len(columns) + 1):
        name, unit = name_and_unit(label)
        own = np.where(np.isinf(column), np.nan, column)
        columns.append(TableColumn(name, place, own, unit or unit_of_name(name)))
    ones = np.ones(len(kept), np.int64)
    return Table(file, tuple(columns), np.array(kept), ones, lines, ",", {}, notes, kept[0])


def _pairs(line: str) -> list[tuple[str, str]]:
    """The labels and numbers of a line; none where it has anything else."""
    found = _LINE.fullmatch(line)
    return list(_each(found["pairs"])) if found else []


def _each(text: str) -> Iterator[tuple[str, str]]:
    return ((name.strip(), value) for name, value in _PARTS.findall(text))


def _clock(line: str) -> str:
    found = _LINE.fullmatch(line)
    return (found["clock"] or "") if found else ""
