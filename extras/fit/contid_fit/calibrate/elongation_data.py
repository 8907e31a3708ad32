"""Measurements of one or more pneumatic sections: pressures, elongation, bending angle, row by row.

CSV with a header; columns ``p1_bar,p2_bar,p3_bar`` and ``elongation_mm`` or ``bend_deg`` or both;
``section`` (1, 2, ..; default 1) and ``trial`` are optional. Cells other than pressures may be empty. An
elongation requires three equal pressures.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from contid.errors import BadInputError, Located
from contid_fit.calibrate.measured_table import Columns, MeasuredRow, read_measured

PRESSURES: Final = ("p1_bar", "p2_bar", "p3_bar")
MEASURED: Final = ("elongation_mm", "bend_deg")
COLUMNS: Final = Columns([[",".join(PRESSURES)]], optional=(*MEASURED, "section"), optional_text=("trial",))
#: Pressures this close count as equal [bar]: a regulator's own accuracy.
EQUAL_BAR: Final = 0.05


@dataclass(frozen=True, slots=True)
class ElongationReading:
    """One row: its line, the pressures that were set, the measured values."""

    line: int
    section: int
    trial: str
    pressures_bar: tuple[float, float, float]
    elongation_mm: float | None
    bend_deg: float | None

    @property
    def average_bar(self) -> float:
        """Average over the six chambers, of which each pressure fills two [bar]."""
        return sum(self.pressures_bar) / 3.0


def elongations(readings: Iterable[ElongationReading], section: int) -> list[ElongationReading]:
    """Readings of one section that determine its modulus: an elongation at a pressure above 0."""
    return [
        reading
        for reading in readings
        if reading.section == section and reading.elongation_mm is not None and reading.average_bar > 0.0
    ]


def read_readings(lines: Iterable[str], name: str) -> list[ElongationReading]:
    """Parse a file; comment lines start with ``#``.

    Raises:
        BadInputError: every invalid row, with line and column.
    """
    rows = read_measured(lines, name, COLUMNS, _findings)
    if not any(column in row.numbers for row in rows for column in MEASURED):
        raise BadInputError([Located(name, 1, 1, f"nothing measured: give {' or '.join(MEASURED)}")])
    return [_reading(row) for row in rows]


def _findings(row: MeasuredRow) -> Iterator[Located]:
    numbers = row.numbers
    for column in (*PRESSURES, "bend_deg"):
        if numbers.get(column, 0.0) < 0.0:
            yield row.finding(column, f"must be 0 or more, not {numbers[column]:g}")
    section = numbers.get("section", 1.0)
    if section < 1.0 or section != int(section):
        yield row.finding("section", f"must be 1, 2, .., not {section:g}")
    pressures = [numbers[column] for column in PRESSURES]
    if "elongation_mm" in numbers and max(pressures) - min(pressures) > EQUAL_BAR:
        yield row.finding("elongation_mm", "requires three equal pressures; leave it empty")


def _reading(row: MeasuredRow) -> ElongationReading:
    p1, p2, p3 = (row.numbers[column] for column in PRESSURES)
    return ElongationReading(
        line=row.line,
        section=int(row.numbers.get("section", 1.0)),
        trial=row.text.get("trial", ""),
        pressures_bar=(p1, p2, p3),
        elongation_mm=row.numbers.get("elongation_mm"),
        bend_deg=row.numbers.get("bend_deg"),
    )
