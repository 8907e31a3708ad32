"""What programs state above the header of a table: facts, names of markers, units, which tables follow."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from contid_adapt.meaning.units import UNITS, unit_word
from contid_adapt.reading.cells import split

_COMMENT_SIGNS: Final = re.compile("^(?:[#% ]|//)+")
#: The tables that Vicon Nexus writes into one file, those with positions first.
_NEXUS: Final = ("Trajectories", "Model Outputs", "Segments", "Joints", "Devices")
_POSITION: Final = re.compile(r"(^|[ ._])[XYZxyz]\d*$")


def stated_facts(lines: Sequence[str], separator: str) -> dict[str, str]:
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
        elif cells[0] in ("Delta_X", "X_Dimension") and len(cells) > 1:  # LabVIEW: a value for each channel
            facts[cells[0]] = cells[1]
        elif ":" in line and len(cells) < 3:
            key, _, value = bare.partition(":")
            facts[key.strip()] = value.strip().strip(separator)
        elif len(cells) == 2:
            facts[cells[0]] = cells[1]
        elif (cells[0].isdigit() and not any(cells[1:])) and before in _NEXUS:
            facts["FREQUENCY"] = cells[0]  # Vicon Nexus: the rate below the kind of the table.
        before = cells[0]
    return facts


def stated_unit(name: str, facts: dict[str, str]) -> str:
    """The unit of a position that a line above the header states, or the manual of the program."""
    if "Position." in name and "Length Units" in facts:
        return unit_word(facts["Length Units"])
    if not _POSITION.search(name):
        return ""
    if "MARKER_NAMES" in facts or "BODY_NAMES" in facts:
        return "mm"
    stated = unit_word(facts.get("Units", ""))
    return stated if UNITS.get(stated, ("",))[0] == "mm" else ""


def names_of_markers(facts: dict[str, str], fields: int) -> list[str]:
    """Names from the MARKER_NAMES of QTM where there is no other header."""
    markers = facts.get("MARKER_NAMES", "").split("\t")
    first = ["Frame", "Time"]
    if markers[0] and fields in (3 * len(markers), 3 * len(markers) + 2):
        own = [f"{marker} {axis}" for marker in markers for axis in "XYZ"]
        return [*(first if fields > 3 * len(markers) else ()), *own]
    return [""] * fields


@dataclass(frozen=True, slots=True)
class NexusTable:
    """One of the tables that Vicon Nexus writes into one file.

    Attributes:
        begin, end: indices of its first line and of the one behind its last.
        note: which tables there are, "" where it is the only one.
    """

    begin: int
    end: int
    note: str


def nexus_table(lines: Sequence[str]) -> NexusTable | None:
    """The table of Vicon Nexus with the positions of markers, or None of another program's text."""
    if lines[0].strip(" ,;\t") not in _NEXUS:
        return None
    begins = [at for at, line in enumerate(lines) if line[:1].isalpha() and line.strip(" ,;\t") in _NEXUS]
    kinds = [lines[at].strip(" ,;\t") for at in begins]
    kind = min(kinds, key=_NEXUS.index)
    own = kinds.index(kind)
    end = begins[own + 1] if own + 1 < len(begins) else len(lines)
    note = ""
    if len(begins) > 1:
        others = ", ".join(f"{name} (line {at + 1})" for name, at in zip(kinds, begins, strict=True))
        note = f"the file has several tables: {others}; {kind} was read, export another one alone to use it"
    return NexusTable(begins[own], end, note)
