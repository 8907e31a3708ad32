"""Tables whose lines are columns: a name, then many numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import islice
from typing import Final

import numpy as np

from contid_adapt.meaning.units import name_and_unit, unit_of_name
from contid_adapt.reading.cells import is_lost, is_number, numbers, split
from contid_adapt.reading.table import Table, TableColumn

#: A table of more lines than that has rows.
_MOST_LINES: Final = 60


def transposed_table(lines: Sequence[str], file: str) -> Table | None:
    """The table of a text whose lines are columns; None for any other.

    Args:
        lines: of the file.
        file: its name in messages.
    """
    given = list(islice((line for line in lines if line.strip()), _MOST_LINES + 1))
    if not 2 <= len(given) <= _MOST_LINES:
        return None
    for separator in (",", ";", "\t"):
        cells = [split(line, separator) for line in given]
        decimal = "," if separator != "," and "," in given[-1] else "."
        if _are_columns(cells, decimal):
            columns = []
            for place, each in enumerate(cells):
                values, wrong = numbers(each[1:], decimal, 0)
                name, unit = name_and_unit(each[0].strip())
                columns.append(TableColumn(name, place + 1, values, unit or unit_of_name(name), tuple(wrong)))
            ones = np.ones(len(cells[0]) - 1, np.int64)
            note = "each line is a column: the table was turned"
            return Table(file, tuple(columns), ones, ones, lines, separator, {}, [note], 1)
    return None


def _are_columns(cells: Sequence[Sequence[str]], decimal: str) -> bool:
    """True where every line has a name and then numbers, and many more of them than there are lines."""
    size = len(cells[0])
    if size < 9 or size < 3 * len(cells) or any(len(each) != size for each in cells):
        return False
    if any(is_number(each[0], decimal) or not re.search("[A-Za-z]", each[0]) for each in cells):
        return False
    return all(is_number(cell, decimal) or is_lost(cell) for each in cells for cell in each[1:])
