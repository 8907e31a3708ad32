"""Measurements as CSV: named columns of numbers, every wrong cell named with its line and column."""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from contid.errors import BadInputError, Located


@dataclass(frozen=True, slots=True)
class MeasuredRow:
    """One row: where it stands, its numbers by column, its words by column."""

    line: int
    numbers: dict[str, float]
    words: dict[str, str]


def read_measured(
    lines: Iterable[str], name: str, choices: Sequence[Sequence[str]], words: Sequence[str] = ()
) -> list[MeasuredRow]:
    """Parse a file; comment lines start with ``#``.

    Args:
        lines: the text.
        name: what messages call it.
        choices: groups of columns; of every group exactly one alternative must be there, an alternative being
            names joined by commas (``"x_px,y_px"`` or ``"x_mm,y_mm"``).
        words: columns of text.

    Raises:
        BadInputError: every wrong row, with line and column.
    """
    header: list[str] | None = None
    findings: list[Located] = []
    rows: list[MeasuredRow] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in next(csv.reader([line]))]
        if header is None:
            header = cells
            findings += _check_header(header, name, number, choices, words)
            if findings:
                break
        elif len(cells) != len(header):
            findings.append(Located(name, number, 1, f"{len(cells)} cells, the header has {len(header)}"))
        else:
            rows.append(_row(header, cells, name, number, words, findings))
    if header is None:
        first = ",".join([*words, *(group[0] for group in choices)])
        findings.append(Located(name, 1, 1, f"empty; the first line names the columns, such as {first}"))
    elif not rows and not findings:
        findings.append(Located(name, 1, 1, "a header without rows"))
    if findings:
        raise BadInputError(findings)
    return rows


def _check_header(
    header: list[str], name: str, line: int, choices: Sequence[Sequence[str]], words: Sequence[str]
) -> list[Located]:
    known = [*words, *(column for group in choices for each in group for column in each.split(","))]
    findings = []
    for cell in header:
        place = header.index(cell) + 1
        if cell not in known:
            near = difflib.get_close_matches(cell, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            findings.append(
                Located(name, line, place, f"unknown column {cell!r}; there are {', '.join(known)}{hint}")
            )
        elif header.count(cell) > 1:
            findings.append(Located(name, line, place, f"column {cell!r} is there twice"))
    for group in choices:
        given = [each for each in group if all(column in header for column in each.split(","))]
        if len(given) != 1:
            found = "none of them" if not given else "more than one of them"
            findings.append(Located(name, line, 1, f"give {' or '.join(group)}; there is {found}"))
    findings += [Located(name, line, 1, f"column {word} is missing") for word in words if word not in header]
    return findings


def _row(
    header: list[str], cells: list[str], name: str, line: int, words: Sequence[str], findings: list[Located]
) -> MeasuredRow:
    numbers: dict[str, float] = {}
    texts: dict[str, str] = {}
    for place, (column, text) in enumerate(zip(header, cells, strict=True), start=1):
        if column in words:
            texts[column] = text
            continue
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            findings.append(Located(name, line, place, f"{column}: {text!r} is no number"))
        numbers[column] = value
    return MeasuredRow(line, numbers, texts)
