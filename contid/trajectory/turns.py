"""Angles of rows that may have been wrapped: a column in -180..180 goes from 180 to -170.

An axis turns from row to row by the difference of the numbers, so this is 350 degrees back. Where a whole
turn more or less is the shorter way it was probably meant; the rows are followed as they are, with a note.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from contid.trajectory.timed import Trajectory
from contid.units import DEG

#: Notes of one trajectory; a wrapped column repeats.
MAX_NOTES: Final = 3
#: Ending of the columns that are angles of axes.
_ENDING: Final = "_deg"
#: Half a turn [rad], and rounding.
_HALF_TURN: Final = math.pi * (1.0 + 1e-9)


def whole_turns(trajectory: Trajectory, name: str) -> Iterator[str]:
    """A note for every row that turns an axis by more than half a turn from the row before.

    Args:
        trajectory: as it was read.
        name: of its source.
    """
    steps = np.diff(trajectory.rows, axis=0)
    columns = [k for k, each in enumerate(trajectory.columns) if each.endswith(_ENDING)]
    found = [(row, k) for k in columns for row in np.nonzero(np.abs(steps[:, k]) > _HALF_TURN)[0].tolist()]
    for row, k in found[:MAX_NOTES]:
        before, after = (float(trajectory.rows[row + i, k]) / DEG for i in (0, 1))
        step = after - before
        shorter = step - 360.0 * round(step / 360.0)
        where = f"{name}:{trajectory.lines[row + 1]}: {trajectory.columns[k]}"
        yield (
            f"{where} goes from {before:g} to {after:g}, which turns the axis by {step:g} degrees; "
            f"if the column wraps, write {before + shorter:g} ({shorter:+g} degrees)"
        )
    if len(found) > MAX_NOTES:
        yield f"{name}: {len(found)} rows turn an axis by more than half a turn"
