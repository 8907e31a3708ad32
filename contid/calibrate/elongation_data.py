"""Measurements of one or more pneumatic sections: pressures, elongation, bending angle, row by row.

CSV with a header; columns ``p1_bar,p2_bar,p3_bar`` and ``elongation_mm`` or ``bend_deg`` or both;
``section`` (1, 2, ..; default 1) and ``trial`` are optional. A cell may be left empty. An elongation counts
only with equal pressures, so a row that has one must have them.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from contid.errors import BadInputError, Located

REQUIRED: Final = ("p1_bar", "p2_bar", "p3_bar")
MEASURED: Final = ("elongation_mm", "bend_deg")
OPTIONAL: Final = ("section", "trial")
#: Pressures this close count as equal [bar]: a regulator's own accuracy.
EQUAL_BAR: Final = 0.05


@dataclass(frozen=True, slots=True)
class Reading:
    """One row: where it stands, what was set, what was measured."""

    line: int
    section: int
    trial: str
    pressures_bar: tuple[float, float, float]
    elongation_mm: float | None
    bend_deg: float | None

    @property
    def average_bar(self) -> float:
        """Average of the six chambers [bar]."""
        return sum(self.pressures_bar) / 3.0


def read_readings(lines: Iterable[str], name: str) -> list[Reading]:
    """Parse a file; comment lines start with ``#``.

    Raises:
        BadInputError: every wrong row, with line and column.
    """
    header: list[str] | None = None
    findings: list[Located] = []
    readings = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in next(csv.reader([line]))]
        if header is None:
            header = cells
            findings += _check_header(header, name, number)
            if findings:
                break
            continue
        if len(cells) != len(header):
            findings.append(Located(name, number, 1, f"{len(cells)} cells, the header has {len(header)}"))
            continue
        reading = _reading(dict(zip(header, cells, strict=True)), header, name, number, findings)
        if reading is not None:
            readings.append(reading)
    if header is None:
        findings.append(Located(name, 1, 1, f"empty; the first line names columns: {','.join(REQUIRED)},.."))
    if findings:
        raise BadInputError(findings)
    return readings


def _check_header(header: list[str], name: str, line: int) -> list[Located]:
    known = (*REQUIRED, *MEASURED, *OPTIONAL)
    findings = [
        Located(name, line, i + 1, f"unknown column {cell!r}; there are {', '.join(known)}")
        for i, cell in enumerate(header)
        if cell not in known
    ]
    findings += [
        Located(name, line, 1, f"column {cell} is missing") for cell in REQUIRED if cell not in header
    ]
    if not any(cell in header for cell in MEASURED):
        findings.append(Located(name, line, 1, f"nothing measured: give {' or '.join(MEASURED)}"))
    return findings


def _reading(
    cells: dict[str, str], header: list[str], name: str, line: int, findings: list[Located]
) -> Reading | None:
    before = len(findings)

    def number(column: str) -> float | None:
        text = cells.get(column, "")
        if not text:
            return None
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            findings.append(Located(name, line, header.index(column) + 1, f"{column}: {text!r} is no number"))
        return value

    pressures = []
    for column in REQUIRED:
        value = number(column)
        if value is None or value < 0.0:
            findings.append(Located(name, line, header.index(column) + 1, f"{column} must be 0 or more"))
        pressures.append(value or 0.0)
    section = number("section") if cells.get("section") else 1.0
    elongation, bend = number("elongation_mm"), number("bend_deg")
    if section is None or section != int(section) or section < 1:
        findings.append(Located(name, line, header.index("section") + 1, "section is 1, 2, .."))
    if elongation is not None and max(pressures) - min(pressures) > EQUAL_BAR:
        at = header.index("elongation_mm") + 1
        findings.append(Located(name, line, at, "an elongation needs three equal pressures; leave it empty"))
    if bend is not None and bend < 0.0:
        findings.append(Located(name, line, header.index("bend_deg") + 1, "bend_deg is 0 or more"))
    if len(findings) > before or section is None:
        return None
    p1, p2, p3 = pressures
    return Reading(line, int(section), cells.get("trial", ""), (p1, p2, p3), elongation, bend)
