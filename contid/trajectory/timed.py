"""A timed trajectory: rows, and the target at any time between them."""

from __future__ import annotations

import copy
import enum
import math
from array import array
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from contid.targets import Target
from contid.trajectory.columns import ColumnLayout
from contid.trajectory.spline import Floats, cubic, linear
from contid.units import DEG

#: Notes of one trajectory about whole turns; a wrapped column repeats.
MAX_NOTES: Final = 3
#: Ending of the columns that are angles of axes.
_ENDING: Final = "_deg"
#: Half a turn [rad], and rounding.
_HALF_TURN: Final = math.pi * (1.0 + 1e-9)


class Interpolation(enum.StrEnum):
    """Interpolation of the target from row to row."""

    CUBIC = "cubic"
    LINEAR = "linear"


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Rows and the curve through them, built by `contid.trajectory.read.read_trajectory`.

    Attributes:
        layout: meaning of the columns.
        rows: SI values in the order of the columns, shape ``(n, columns)``.
        lines: line of every row in the file.
        interpolation: cubic or linear.
        within_reach: a check found every target within reach.
    """

    layout: ColumnLayout
    rows: Floats
    lines: Sequence[int]
    interpolation: Interpolation = Interpolation.CUBIC
    within_reach: bool = field(default=False, init=False)
    _times: array[float] = field(init=False, repr=False)
    _coefficients: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Compute the curve once."""
        assert self.layout.time is not None
        times = self.rows[:, self.layout.time]
        # Of the powers 0 to 3 of the time since a row, for every interval, shape (n - 1, 4, columns).
        coefficients = np.zeros((0, 4, self.rows.shape[1]))
        if len(times) > 1:
            coefficients = linear(times, self.rows)
            if self.interpolation is Interpolation.CUBIC:
                # Loads and measurements are interpolated linearly.
                for robot in self.layout.robots:
                    columns = list(robot.moving)
                    coefficients[:, :, columns] = cubic(times, self.rows[:, columns])
        object.__setattr__(self, "_times", array("d", times.tobytes()))
        object.__setattr__(self, "_coefficients", coefficients)

    @property
    def start_s(self) -> float:
        """Time of the first row."""
        return self._times[0]

    @property
    def end_s(self) -> float:
        """Time of the last row."""
        return self._times[-1]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns as written."""
        return self.layout.names

    def __len__(self) -> int:
        """Number of rows."""
        return len(self._times)

    def time_of_row(self, index: int) -> float:
        """Time of a row [s]."""
        return self._times[index]

    def row_at(self, time_s: float) -> int:
        """Index of the last row at or before ``time_s``; the first row for any earlier time."""
        return max(bisect_right(self._times, time_s) - 1, 0)

    @property
    def times_s(self) -> Floats:
        """Times of the rows."""
        return np.frombuffer(self._times)

    def rows_at(self, times_s: Floats) -> NDArray[np.intp]:
        """Index of the last row at or before each time; -1 before the first."""
        return np.searchsorted(self.times_s, times_s, side="right") - 1

    def targets_at(self, time_s: float) -> Mapping[str, Target]:
        """Target of every robot that has columns, in the world frame.

        Exactly a row at its own time; the first row before it, the last row after it.
        """
        return self.layout.targets(self.values_at(time_s))

    def values_at(self, time_s: float) -> list[float]:
        """SI values of the columns at a time, as `targets_at`."""
        index = bisect_right(self._times, time_s) - 1
        if index < 0 or index >= len(self._coefficients):
            end: list[float] = self.rows[0 if index < 0 else -1].tolist()
            return end
        c0, c1, c2, c3 = self._coefficients[index]
        u = time_s - self._times[index]
        row: list[float] = (((c3 * u + c2) * u + c1) * u + c0).tolist()
        return row

    def values_of_many(self, times_s: Floats) -> Floats:
        """`values_at` of many times, shape ``(times, columns)``."""
        index = self.rows_at(times_s)
        inside = (index >= 0) & (index < len(self._coefficients))
        # The first or the last row for every time; times on the curve are replaced below.
        rows: Floats = self.rows[np.where(index < 0, 0, -1)]
        at = index[inside]
        u = (times_s[inside] - self.times_s[at])[:, None]
        c0, c1, c2, c3 = self._coefficients[at].transpose(1, 0, 2)
        rows[inside] = ((c3 * u + c2) * u + c1) * u + c0
        return rows

    def stretched(self, factor: float) -> Trajectory:
        """The same path, each of its parts ``factor`` times slower; it begins at the same time.

        It does not count as `within_reach`, whatever this one does: `accepted` marks it after its own check.
        """
        assert self.layout.time is not None
        rows = self.rows.copy()
        times = rows[:, self.layout.time]
        rows[:, self.layout.time] = times[0] + factor * (times - times[0])
        rows.setflags(write=False)
        return Trajectory(self.layout, rows, self.lines, self.interpolation)

    def accepted(self) -> Trajectory:
        """The same trajectory, marked as one whose targets were all found within reach."""
        same = copy.copy(self)
        object.__setattr__(same, "within_reach", True)
        return same

    def targets_of_row(self, index: int) -> Mapping[str, Target]:
        """Targets of row ``index``."""
        return self.layout.targets(self.rows[index].tolist())


def whole_turns(trajectory: Trajectory, name: str) -> Iterator[str]:
    """A note for every row that turns an axis by more than half a turn from the row before.

    Such a column may have been wrapped into -180..180 degrees; its rows are followed as they are.

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
