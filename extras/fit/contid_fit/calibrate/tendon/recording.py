"""Recordings of tendon robots: the pull of every tendon and the measured tip, row by row.

CSV with the columns ``timestamp`` [s], ``pattern_label``, one ``servo_<id>_mm`` per tendon (positive: the
tendon is pulled in), and ``tip_x,tip_y,tip_z`` [mm], as in the motion captures of
``ContinuumRoboticsLab/opencr-mujoco``. Tendons with a load cell at either end have ``servo_<id>_near_n``
(at the motor) and ``servo_<id>_far_n`` [N] as well. Rows with the same label form one pattern; the suffix
``_hold`` of a label does not count.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from contid.errors import BadInputError, Located
from contid.kinematics.array import Array
from contid_fit.calibrate.measured_table import Columns, MeasuredRow, cells_of, read_measured

_SERVO = re.compile(r"servo_\w+_mm")
_TIP = ("tip_x", "tip_y", "tip_z")
_HOLD = "_hold"


@dataclass(frozen=True, eq=False)
class TendonRecording:
    """Rows in the order of time; the robot keeps its state from row to row.

    Attributes:
        name: name of the data, in messages.
        pattern: label of each row, without ``_hold``.
        servos: name of each column of ``pull_m``.
        pull_m: pull of each tendon [m], shape ``(rows, tendons)``.
        tip_m: measured tip [m], shape ``(rows, 3)``.
        ends_n: tensions of each tendon at motor and body, shape ``(rows, tendons, 2)``; NaN without cells.
        joins: rows with which a recording after the first begins (`followed_by`).
    """

    name: str
    pattern: tuple[str, ...]
    servos: tuple[str, ...]
    pull_m: Array
    tip_m: Array
    ends_n: Array | None = None
    joins: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.pattern)

    @property
    def runs(self) -> Array:
        """Number of the run of each row, from 0, shape ``(rows,)``.

        A change of the label begins a run, and so does another recording (`followed_by`).

        Whole numbers as floats, like every `Array`.
        """
        labels = np.array(self.pattern)
        changes = np.flatnonzero(labels[1:] != labels[:-1]) + 1
        begins = np.zeros(len(self))
        begins[changes] = 1.0
        begins[list(self.joins)] = 1.0
        return np.cumsum(begins)

    def rows(self, start: int, stop: int) -> TendonRecording:
        """The rows from ``start`` to before ``stop``."""
        part = slice(start, stop)
        return replace(
            self,
            pattern=self.pattern[part],
            pull_m=self.pull_m[part],
            tip_m=self.tip_m[part],
            joins=tuple(row - start for row in self.joins if start < row < stop),
            ends_n=None if self.ends_n is None else self.ends_n[part],
        )

    def in_order(self, columns: Iterable[int]) -> TendonRecording:
        """The same rows with other columns of pulls."""
        order = list(columns)
        ends_n = None if self.ends_n is None else self.ends_n[:, order]
        servos = tuple(self.servos[i] for i in order)
        return replace(self, servos=servos, pull_m=self.pull_m[:, order], ends_n=ends_n)

    def followed_by(self, other: TendonRecording) -> TendonRecording:
        """Both, one after the other; the robot keeps its state from the last row of this one to the other's.

        Raises:
            BadInputError: other servos.
        """
        if other.servos != self.servos:
            message = f"its servos are not those of {self.name}, or in another order"
            raise BadInputError([Located(other.name, 1, 1, message)])
        return TendonRecording(
            f"{self.name} and {other.name}",
            self.pattern + other.pattern,
            self.servos,
            np.concatenate((self.pull_m, other.pull_m)),
            np.concatenate((self.tip_m, other.tip_m)),
            # The coefficient is that of this recording; the other one is predicted.
            None if self.ends_n is None else np.concatenate((self.ends_n, other._ends())),
            (*self.joins, len(self), *[len(self) + row for row in other.joins]),
        )

    def _ends(self) -> Array:
        return np.full((*self.pull_m.shape, 2), np.nan) if self.ends_n is None else self.ends_n


def read_recording(lines: Iterable[str], name: str) -> TendonRecording:
    """Read a CSV.

    Raises:
        BadInputError: every invalid cell, missing columns, or times that go back.
    """
    text = list(lines)
    content = (
        (n, line) for n, line in enumerate(text, 1) if line.strip() and not line.lstrip().startswith("#")
    )
    number, header = next(content, (1, ""))
    cells: list[str] = []
    with suppress(csv.Error):  # `read_measured` refuses the header
        cells = cells_of(header)
    servos = tuple(cell for cell in cells if _SERVO.fullmatch(cell))
    ends = {servo: [servo.removesuffix("mm") + end for end in ("near_n", "far_n")] for servo in servos}
    ends = {servo: pair for servo, pair in ends.items() if set(pair) & set(cells)}
    # Groups of one name each: no column has an alternative.
    cell_columns = [end for pair in ends.values() for end in pair]
    groups = [(column,) for column in ("timestamp", *servos, *_TIP, *cell_columns)]
    columns = Columns(groups, text=("pattern_label",))
    if cells and len(servos) < 3:
        message = f"{len(servos)} columns servo_<id>_mm; a tendon robot has three or more"
        raise BadInputError([Located(name, number, 1, message)])
    last_s = -math.inf

    def in_time(row: MeasuredRow) -> Iterator[Located]:
        nonlocal last_s
        time_s = row.numbers["timestamp"]
        if time_s < last_s:
            yield row.finding("timestamp", f"{time_s} is before the row above")
        last_s = time_s

    rows = read_measured(text, name, columns, in_time)
    ends_n = np.full((len(rows), len(servos), 2), np.nan)
    for servo, pair in ends.items():
        ends_n[:, servos.index(servo)] = [[row.numbers[end] for end in pair] for row in rows]
    return TendonRecording(
        name,
        tuple(row.text["pattern_label"].removesuffix(_HOLD) for row in rows),
        servos,
        np.array([[row.numbers[servo] for servo in servos] for row in rows]) * 1e-3,
        np.array([[row.numbers[axis] for axis in _TIP] for row in rows]) * 1e-3,
        ends_n if ends else None,
    )
