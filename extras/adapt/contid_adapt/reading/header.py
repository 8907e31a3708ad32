"""The lines above the rows: names of columns, units, rows of names above names, and stated facts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from contid.errors import BadInputError, Located
from contid_adapt.meaning.units import UNITS, name_and_unit, unit_of_name, unit_word
from contid_adapt.reading.cells import is_number, split
from contid_adapt.reading.dialect import Dialect, is_comment, names_separator

#: Rows of Motive and others that name kinds or numbers of things, never columns.
_KINDS: Final = frozenset({
    *("type", "id", "parent", "marker", "bone", "skeleton", "solved", "rigid body", "rigid body marker"),
    *("marker set", "force plate", "unlabeled", "trajectories"),
})  # fmt: skip
_COMMENT_SIGNS: Final = re.compile("^(?:[#% ]|//)+")
_NUMBERED: Final = re.compile(r"^[0-9A-Fa-f:]{6,}$|^\d+$|^ROOT$|^id\d+$", re.IGNORECASE)


#: Index of a line and its cells.
_Line: TypeAlias = tuple[int, list[str]]


@dataclass(slots=True)
class TableHeader:
    """What stands above the rows.

    Attributes:
        names: one for each field.
        units: one for each field, "" for none.
        line: of the names, from 1; 0 where there are none.
        facts: of lines with a key and a value.
        lines: the line of the names as written, which begins another session where it comes again.
    """

    names: list[str] = field(default_factory=list)
    units: list[str] = field(default_factory=list)
    line: int = 0
    facts: dict[str, str] = field(default_factory=dict)
    lines: frozenset[str] = frozenset()


def read_header(lines: Sequence[str], dialect: Dialect, file: str) -> TableHeader:
    """Interpret the lines above the first row.

    Raises:
        BadInputError: a line of numbers with another count of cells stands between names and rows.
    """
    header = TableHeader(facts=_facts(lines[: dialect.start], dialect.separator))
    above, odd = _lines_above(lines, dialect, file)
    fields, place = dialect.fields, len(above) - 1
    first = split(lines[dialect.start], dialect.separator)
    if odd and (place < 0 or odd.line > above[place][0] or not _fits(above[place][1], fields, header.facts)):
        raise BadInputError([odd])
    units: list[str] = []
    if place > 0 and _are_units(above[place][1], fields):
        units = _filled([unit_word(cell) for cell in above[place][1]], fields)
        place -= 1
    if place >= 0 and _fits(above[place][1], fields, header.facts, first):
        index = above[place][0]
        header.line, header.lines = index + 1, frozenset({lines[index]})
        header.names = _names(above[: place + 1], first, fields)
    else:
        header.names = _of_markers(header.facts, fields)
        if place >= 0 and not any(header.names) and above[place][0] == dialect.start - 1:
            _check_count(above[place][1], above[place][0], fields, header.facts, file)
    found = [name_and_unit(name) for name in header.names]
    header.names = [name for name, _ in found]
    units = units or [""] * fields
    header.units = [
        own or unit or unit_of_name(name) or _stated_unit(name, header.facts)
        for own, (name, unit) in zip(units, found, strict=True)
    ]
    return header


def _lines_above(lines: Sequence[str], dialect: Dialect, file: str) -> tuple[list[_Line], Located | None]:
    """The lines above the first row that may have names or units, and the first one of numbers."""
    above: list[_Line] = []
    odd: Located | None = None
    for index, line in enumerate(lines[: dialect.start]):
        if not line.strip() or names_separator(line):
            continue
        bare = re.sub(r"^\s*(#|%|//)+\s?", "", line)
        cells = [cell.strip() for cell in split(bare, dialect.separator)]
        if len(cells) == 1 and is_comment(line) and dialect.separator != " ":
            cells = [cell.strip() for cell in split(bare, ",")]
        if not any(cells):
            continue
        right = sum(is_number(cell, dialect.decimal) for cell in cells)
        if is_comment(line) or len(cells) < 3 or 2 * right <= sum(map(bool, cells)):
            above.append((index, cells))
        elif odd is None:
            what = f"a line of {len(cells)} numbers above rows of {dialect.fields}; is its separator right?"
            odd = Located(file, index + 1, 1, what)
    return above, odd


def _names(above: Sequence[_Line], first: Sequence[str], fields: int) -> list[str]:
    """One name for each field.

    Args:
        above: lines above the rows down to that of the names. Those above it are names of groups of columns
            where the names repeat, or where half of them stand one line above.
        first: cells of the first row.
        fields: cells of a row.
    """
    index, cells = above[-1]
    names = _filled(cells, fields)
    if len(cells) == fields - 1 and len(_trimmed(cells)) == len(cells) and cells[0] and first[-1].strip():
        names = ["?", *cells]  # One name fewer: the first column counts rows.
    given = [name for name in names if name]
    grouped = len({*given}) < len(given)
    if len(above) > 1 and len(up := above[-2][1]) > 2:
        grouped = grouped or not up[0] or (not names[0] and bool(up[1]))
    levels: list[list[str]] = []
    for at, level in reversed(above[:-1] if grouped else ()):
        if index - at != 1 or not _is_level(level, fields):
            break
        index = at
        levels.insert(0, level)
    return _joined(names, [each for each in levels if not _is_kind(each)], fields)


def _check_count(cells: Sequence[str], index: int, fields: int, facts: dict[str, str], file: str) -> None:
    """Refuse names of another count than rows have, which would stand above the wrong columns."""
    names = _trimmed(cells)
    if len(names) > 2 and names[0] not in facts:
        what = f"{len(names)} names above rows of {fields} cells"
        remedy = "correct the header, or delete it and name columns c1, c2, .."
        raise BadInputError([Located(file, index + 1, 1, f"{what}; {remedy}")])


def _stated_unit(name: str, facts: dict[str, str]) -> str:
    """The unit of a position that a line above the header states, or the manual of the program."""
    if "Position." in name and "Length Units" in facts:
        return unit_word(facts["Length Units"])
    if "DataRate" in facts:
        return unit_word(facts.get("Units", "")) if re.search(r"(^|[ .])[XYZ]\d*$", name) else ""
    if "MARKER_NAMES" in facts or "BODY_NAMES" in facts:
        return "mm" if re.search(r"(^|[ .])[XYZ]$", name) else ""
    return ""


def _facts(lines: Sequence[str], separator: str) -> dict[str, str]:
    """What lines above the rows state, by its key, in the forms that programs write."""
    facts: dict[str, str] = {}
    before = ""
    for number, line in enumerate(lines):
        bare = _COMMENT_SIGNS.sub("", line)
        cells = [cell.strip() for cell in split(bare, separator)] or [""]
        if cells[0].isupper() and len(cells) > 1:  # QTM: MARKER_NAMES<tab>A<tab>B
            facts[cells[0]] = "\t".join(cells[1:]).strip()
        elif cells[0] == "Format Version":  # Motive: key, value, key, value
            facts |= dict(zip(cells[::2], cells[1::2], strict=False))
        elif cells[0] == "DataRate" and number + 1 < len(lines):  # TRC: keys, and their values below
            facts |= dict(zip(cells, split(lines[number + 1], separator), strict=False))
        elif ":" in line and len(cells) < 3:
            key, _, value = bare.partition(":")
            facts[key.strip()] = value.strip().strip(separator)
        elif len(cells) == 2:
            facts[cells[0]] = cells[1]
        elif (cells[0].isdigit() and not any(cells[1:])) and before in ("Trajectories", "Segments"):
            facts["FREQUENCY"] = cells[0]  # Vicon Nexus: the rate below the kind of the table.
        before = cells[0]
    return facts


def _are_units(cells: Sequence[str], fields: int) -> bool:
    """True for a line of units: six of ten cells are units or signs for none."""
    given = [cell for cell in cells if cell]
    names = sum(unit_word(cell) in UNITS or cell in "[]-()" for cell in given)
    return bool(given) and len(cells) <= fields + 1 and 10 * names >= 6 * len(given)


def _fits(cells: Sequence[str], fields: int, facts: dict[str, str], first: Sequence[str] = ()) -> bool:
    """True for a line of names; cells behind the last name are empty in the first row."""
    trimmed = _trimmed(cells)
    if len(trimmed) > 2 and first and not any(cell.strip() for cell in first[len(trimmed) :]):
        fields = min(fields, len(trimmed))
    if len(trimmed) < 2 and fields > 1:
        return False
    if trimmed and trimmed[0] in facts and trimmed[0].isupper() and len(trimmed[0]) > 4:
        return False
    return fields - 1 <= len(trimmed) <= fields or len(cells) == fields


def _trimmed(cells: Sequence[str]) -> list[str]:
    kept = list(cells)
    while kept and not kept[-1]:
        kept.pop()
    return kept


def _filled(cells: Sequence[str], fields: int) -> list[str]:
    return [*cells, *[""] * fields][:fields]


def _is_level(cells: Sequence[str], fields: int) -> bool:
    """True for a line that may name groups of columns."""
    return len(cells) > 2 and len(_trimmed(cells)) <= fields and "Format Version" not in cells


def _is_kind(cells: Sequence[str]) -> bool:
    """A row of kinds (Rigid Body) or numbers of things."""
    given = [cell for cell in cells if cell]
    if cells[0] == "" and given and given[0] in ("Type", "ID", "Parent"):
        return True
    return all(cell.lower() in _KINDS or _NUMBERED.match(cell) for cell in given)


def _joined(names: list[str], levels: Sequence[Sequence[str]], fields: int) -> list[str]:
    """Names with those above in front; an empty cell of a row above continues the one before it."""
    for level in reversed(levels):
        above, last = [], ""
        for place, cell in enumerate(_filled(level, fields)):
            last = cell or (last if place < len(names) and names[place] else "")
            above.append("" if last == "Name" else last)
        names = [f"{up}.{name}" if up and name and up != name else name or up
                 for up, name in zip(above, names, strict=True)]  # fmt: skip
    return names


def _of_markers(facts: dict[str, str], fields: int) -> list[str]:
    """Names from the MARKER_NAMES of QTM where there is no other header."""
    markers = facts.get("MARKER_NAMES", "").split("\t")
    first = ["Frame", "Time"]
    if markers[0] and fields in (3 * len(markers), 3 * len(markers) + 2):
        own = [f"{marker} {axis}" for marker in markers for axis in "XYZ"]
        return [*(first if fields > 3 * len(markers) else ()), *own]
    return [""] * fields
