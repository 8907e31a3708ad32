"""Many lines of plain numbers to rows of SI values at once, as `contid.trajectory.rows` reads single ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from contid.trajectory.columns import ColumnLayout
from contid.trajectory.rows import MAX_NUMBER
from contid.trajectory.spline import Floats
from contid.units import MAX_LINE

#: Lines that are read at once.
LINES: Final = 8192


def plain_rows(layout: ColumnLayout, lines: Sequence[str], least_s: float) -> Floats | None:
    """Rows ``(lines, columns)`` in SI of lines of a CSV; None where one of them needs a closer look.

    That is where anything is wrong, for quotes, and for columns that a row replaces by others.

    Args:
        layout: of the columns, with a time.
        lines: without comments and blank lines.
        least_s: between two rows.
    """
    size = len(layout.names)
    if any(each.x_axis or each.arcs for each in layout.robots) or max(map(len, lines)) > MAX_LINE:
        return None
    try:
        values = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    if values.shape != (len(lines), size):
        return None
    rows: Floats = values * layout.factors / layout.divisors
    if not np.abs(values).max() <= MAX_NUMBER:  # NaN is not
        return None
    if not (np.diff(rows[:, layout.time]) >= least_s).all():
        return None
    if any(each.direction and not rows[:, each.direction].any(axis=1).all() for each in layout.robots):
        return None
    return rows
