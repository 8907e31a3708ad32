"""The lines above the rows: which of them has the names of the columns, and which their units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from contid.errors import BadInputError, Located
from contid_adapt.meaning.units import UNITS, name_and_unit, unit_of_name, unit_word
from contid_adapt.reading.cells import is_number, split
from contid_adapt.reading.column_names import LineAbove, column_names, filled, trimmed, without_index_line
from contid_adapt.reading.dialect import COMMENTS, Dialect, ends_preamble, is_comment, names_separator
from contid_adapt.reading.preamble import names_of_markers, stated_facts, stated_unit

#: Signs of which a line below the names may consist: ``-----+-----``.
_RULE: Final = " \t-+=|\r"
_WIDE_BLANKS: Final = re.compile(r"\s{2,}")
_BLANK_BEFORE_NAME: Final = re.compile(r"\s+(?![\[(])")
_COMMENT_SIGN: Final = re.compile(r"^\s*(#|%|//)+\s?")


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
    fields = dialect.fields
    header = TableHeader(facts=stated_facts(lines[: dialect.start], dialect.separator))
    first = split(lines[dialect.start], dialect.separator)
    above, odd = _lines_above(lines, dialect, file)
    if odd and (not above or odd.line > above[-1].place or not _fits(above[-1].cells, header.facts, fields)):
        raise BadInputError([odd])
    units = [""] * fields
    if len(above) > 1 and _are_units(above[-1].cells, fields):
        units = filled([unit_word(cell) for cell in above.pop().cells], fields)
    above = without_index_line(above, fields)
    if above and _fits(above[-1].cells, header.facts, fields, first):
        index = above[-1].place
        header.line, header.lines = index + 1, frozenset({lines[index]})
        header.names = column_names(above, first, fields)
    else:
        header.names = names_of_markers(header.facts, fields)
        if above and not any(header.names) and above[-1].place == dialect.start - 1:
            _check_count(above[-1], fields, header.facts, file)
    found = [name_and_unit(name) for name in header.names]
    header.names = [name for name, _ in found]
    header.units = [
        own or unit or unit_of_name(name) or stated_unit(name, header.facts)
        for own, (name, unit) in zip(units, found, strict=True)
    ]
    return header


def _lines_above(lines: Sequence[str], dialect: Dialect, file: str) -> tuple[list[LineAbove], Located | None]:
    """The lines above the first row that may have names or units, and the first one of numbers."""
    above: list[LineAbove] = []
    odd: Located | None = None
    for index, line in enumerate(lines[: dialect.start]):
        if ends_preamble(line):
            above, odd = [], None
            continue
        if not line.strip(_RULE) or names_separator(line):
            continue
        cells = _cells_above(line, dialect)
        if not any(cells):
            continue
        if dialect.comments and cells[-1] == COMMENTS:
            cells.pop()
        right = sum(is_number(cell, dialect.decimal) for cell in cells)
        numbers_of_things = len(cells) == dialect.fields and not any(cells[:2])
        if is_comment(line) or len(cells) < 3 or 2 * right <= sum(map(bool, cells)) or numbers_of_things:
            above.append(LineAbove(index, cells, is_comment(line)))
        elif odd is None:
            what = f"a line of {len(cells)} numbers above rows of {dialect.fields}; is its separator right?"
            odd = Located(file, index + 1, 1, what)
    return above, odd


def _cells_above(line: str, dialect: Dialect) -> list[str]:
    """The cells of a line above the rows; a comment may have another separator than they have."""
    bare = _COMMENT_SIGN.sub("", line)
    cells = [cell.strip() for cell in split(bare, dialect.separator)]
    if dialect.separator == " " and len(cells) > dialect.fields:
        # Names with blanks inside have more of them between, or a unit in brackets behind them.
        for form in (_WIDE_BLANKS, _BLANK_BEFORE_NAME):
            if len(others := form.split(bare.strip())) == dialect.fields:
                return others
    if not is_comment(line) or len(cells) > 1:
        return cells
    for separator in (",", ";", "\t", " "):
        others = [cell.strip() for cell in split(bare, separator)]
        if separator != dialect.separator and len(others) == dialect.fields:
            return others
    return [cell.strip() for cell in split(bare, ",")] if dialect.separator != " " else cells


def _check_count(line: LineAbove, fields: int, facts: dict[str, str], file: str) -> None:
    """Refuse names of another count than rows have, which would stand above the wrong columns."""
    names = trimmed(line.cells)
    if len(names) > 2 and names[0] not in facts:
        what = f"{len(names)} names above rows of {fields} cells"
        remedy = "correct the header, or delete it and name columns c1, c2, .."
        raise BadInputError([Located(file, line.place + 1, 1, f"{what}; {remedy}")])


def _are_units(cells: Sequence[str], fields: int) -> bool:
    """True for a line of units: six of ten cells are units or signs for none."""
    given = [cell for cell in cells if cell]
    names = sum(unit_word(cell) in UNITS or cell in "[]-()" for cell in given)
    return bool(given) and len(cells) <= fields + 1 and 10 * names >= 6 * len(given)


def _fits(cells: Sequence[str], facts: dict[str, str], fields: int, first: Sequence[str] = ()) -> bool:
    """True for a line of names; cells behind the last name are empty in the first row."""
    names = trimmed(cells)
    if len(names) > 2 and first and not any(cell.strip() for cell in first[len(names) :]):
        fields = min(fields, len(names))
    if len(names) < 2 and fields > 1:
        return False
    if names and names[0] in facts and names[0].isupper() and len(names[0]) > 4:
        return False
    return fields - 1 <= len(names) <= fields or len(cells) == fields
