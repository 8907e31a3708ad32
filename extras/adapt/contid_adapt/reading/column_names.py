"""The names of columns from the lines above them: groups in front, lines that are no names left out."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

#: Rows of Motive and others that name kinds or numbers of things, never columns.
_KINDS: Final = frozenset({
    *("type", "id", "parent", "marker", "bone", "skeleton", "solved", "rigid body", "rigid body marker"),
    *("marker set", "force plate", "unlabeled", "trajectories"),
})  # fmt: skip
_NUMBERED: Final = re.compile(r"^[0-9A-Fa-f:]{6,}$|^\d+$|^ROOT$|^id\d+$", re.IGNORECASE)


class LineAbove(NamedTuple):
    """A line above the rows.

    Attributes:
        place: index of the line.
        cells: without signs of comments.
        is_comment: it began with one.
    """

    place: int
    cells: list[str]
    is_comment: bool = False


def column_names(above: Sequence[LineAbove], first: Sequence[str], fields: int) -> list[str]:
    """One name for each field; "?" for a column that the header has no name for.

    Args:
        above: lines above the rows down to that of the names. Those above it are names of groups of columns
            where the names repeat, or where half of them stand one line above.
        first: cells of the first row.
        fields: cells of a row.
    """
    cells = above[-1].cells
    names = filled(cells, fields)
    if len(cells) == fields - 1 and len(trimmed(cells)) == len(cells) and cells[0] and first[-1].strip():
        names = ["?", *cells]  # One name fewer: the first column counts rows.
    levels = _levels(above, fields) if _is_grouped(above, names) else []
    return _joined(names, [each for each in levels if not _is_kind(each)], fields)


def without_index_line(above: list[LineAbove], fields: int) -> list[LineAbove]:
    """The lines without one that names the index alone, which pandas writes below columns of several levels.

    ``body,tip,tip`` / ``axis,x,y`` / ``t,,`` becomes ``,tip,tip`` / ``t,x,y``: the first cells name levels.
    """
    if len(above) < 2:
        return above
    own, up = above[-1].cells, above[-2].cells
    alone = bool(own[0]) and not any(own[1:])
    if not alone or len(own) != fields or len(up) != fields or not all(up[1:]):
        return above
    levels = [line._replace(cells=["", *line.cells[1:]]) for line in above[:-2]]
    return [*levels, above[-2]._replace(cells=[own[0], *up[1:]])]


def filled(cells: Sequence[str], fields: int) -> list[str]:
    """Cells of a line, as many as fields."""
    return [*cells, *[""] * fields][:fields]


def trimmed(cells: Sequence[str]) -> list[str]:
    """Cells of a line without empty ones at its end."""
    kept = list(cells)
    while kept and not kept[-1]:
        kept.pop()
    return kept


def _is_grouped(above: Sequence[LineAbove], names: Sequence[str]) -> bool:
    """True where the names of several columns are equal, or a part of them stands one line above."""
    given = [name for name in names if name]
    if len({*given}) < len(given):
        return True
    up = above[-2].cells if len(above) > 1 else []
    return len(up) > 2 and (not up[0] or (not names[0] and bool(up[1])))


def _levels(above: Sequence[LineAbove], fields: int) -> list[list[str]]:
    """The lines of groups right above the names, the highest first."""
    levels: list[list[str]] = []
    below = above[-1]
    for line in reversed(above[:-1]):
        if below.place - line.place != 1 or line.is_comment != below.is_comment:
            break
        if len(line.cells) < 3 or len(trimmed(line.cells)) > fields or "Format Version" in line.cells:
            break
        levels.insert(0, line.cells)
        below = line
    return levels


def _is_kind(cells: Sequence[str]) -> bool:
    """True for a row of kinds (Rigid Body) or numbers of things."""
    given = [cell for cell in cells if cell]
    if cells[0] == "" and given and given[0] in ("Type", "ID", "Parent"):
        return True
    return all(cell.lower() in _KINDS or _NUMBERED.match(cell) for cell in given)


def _joined(names: list[str], levels: Sequence[Sequence[str]], fields: int) -> list[str]:
    """Names with those above in front; an empty cell of a row above continues the one before it."""
    for level in reversed(levels):
        above, last = [], ""
        for place, cell in enumerate(filled(level, fields)):
            last = cell or (last if place < len(names) and names[place] else "")
            above.append("" if last == "Name" else last)
        names = [f"{up}.{name}" if up and name and up != name else name or up
                 for up, name in zip(above, names, strict=True)]  # fmt: skip
    return names
