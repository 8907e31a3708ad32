"""Columns of the bends of sections: ``s1.bend_deg, s1.azimuth_deg, s1.length_mm`` of each of them.

A section bends by an angle towards an azimuth, counter-clockwise from +x seen from +z where it starts. Rows
have these two angles at the edge and the components of the bend inside,

    u = bend cos azimuth        v = bend sin azimuth,

which have no jump where the azimuth wraps, nor at the straight section, where it has no meaning: a curve
through rows is one through components. A planar robot bends in its plane: it has no azimuth, and a negative
bend is one to the other side. A length that does not change has no column; where the column of one that does
is left out, it is the one nearest to the rest pose with which the section may bend so far to any side.
``s1.curvature_per_m`` is the bend per length, in place of the bend.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from contid.robot_file.base import Quantity
from contid.robot_file.robot import RobotDescription
from contid.trajectory.meaning import Meaning

GROUP: Final = "arcs"
#: Places of the columns of a section in the group, and how many each section has.
_BEND, _AZIMUTH, _LENGTH, _CURVATURE = range(4)
_PLACES: Final = 4
#: A bend below this is rounding, and so is its azimuth [rad].
_STRAIGHT_RAD: Final = 1e-9


@dataclass(frozen=True, slots=True)
class SectionColumns:
    """Indices in a row of the columns of one section.

    Attributes:
        bend: index of its bend, or of its curvature.
        azimuth: index of its azimuth; None for a planar robot.
        length: index of its length; None without a column.
        length_m: its length without a column; 0 for one that the model chooses.
        curved: ``bend`` is the index of its curvature.
    """

    bend: int
    azimuth: int | None
    length: int | None
    length_m: float
    curved: bool

    @property
    def moving(self) -> Iterator[int]:
        """Indices of its columns."""
        return (index for index in (self.bend, self.azimuth, self.length) if index is not None)

    def resolve(self, row: list[float]) -> None:
        """Replace bend and azimuth in a row of SI values by the components of the bend [rad]."""
        bend = row[self.bend]
        if self.curved:
            bend *= self.length_m if self.length is None else row[self.length]
        row[self.bend] = bend
        if self.azimuth is not None:
            azimuth = row[self.azimuth]
            row[self.bend], row[self.azimuth] = bend * math.cos(azimuth), bend * math.sin(azimuth)

    def restore(self, row: list[float]) -> None:
        """Undo `resolve`; the azimuth of a straight section is 0."""
        u, v, length_m = self.arc(row)
        bend = u if self.azimuth is None else math.hypot(u, v)
        row[self.bend] = bend / length_m if self.curved else bend
        if self.azimuth is not None:
            row[self.azimuth] = math.atan2(v, u)

    def arc(self, row: Sequence[float]) -> tuple[float, float, float]:
        """Components of the bend [rad] and length [m] in a row whose angles are resolved."""
        v = 0.0 if self.azimuth is None else row[self.azimuth]
        return row[self.bend], v, self.length_m if self.length is None else row[self.length]


def arc_meanings(robot: RobotDescription) -> dict[str, Meaning]:
    """The columns of the sections of a robot, without its name in front."""
    known = {}
    divisor, factor = Quantity.ANGLE.edge_si
    for number, length in enumerate(robot.section_lengths):
        name, place = f"s{number + 1}", _PLACES * number
        known[f"{name}.bend_deg"] = Meaning(GROUP, place + _BEND, factor, divisor)
        if robot.dimension == 3:
            known[f"{name}.azimuth_deg"] = Meaning(GROUP, place + _AZIMUTH, factor, divisor)
        if length.changes:
            known[f"{name}.length_mm"] = Meaning(GROUP, place + _LENGTH, divisor=Quantity.LENGTH.per_si)
        known[f"{name}.curvature_per_m"] = Meaning(GROUP, place + _CURVATURE)
    return known


def missing_arcs(robot: RobotDescription, given: set[int]) -> list[str]:
    """Columns that a robot needs beside those with these places of the group."""
    missing = []
    for number, length in enumerate(robot.section_lengths):
        name, place = f"s{number + 1}", _PLACES * number
        if not given & {place + _BEND, place + _CURVATURE}:
            missing.append(f"{name}.bend_deg")
        if robot.dimension == 3 and place + _AZIMUTH not in given:
            missing.append(f"{name}.azimuth_deg")
        if length.changes and place + _CURVATURE in given and place + _LENGTH not in given:
            missing.append(f"{name}.length_mm")
    return missing


def doubled_arcs(robot: RobotDescription, given: set[int]) -> list[str]:
    """Sections that have both a bend and a curvature."""
    places = ((f"s{n + 1}", _PLACES * n) for n in range(len(robot.section_lengths)))
    return [name for name, place in places if {place + _BEND, place + _CURVATURE} <= given]


def section_columns(robot: RobotDescription, indices: Mapping[int, int]) -> tuple[SectionColumns, ...]:
    """The columns of every section; empty where one has no bend.

    Args:
        robot: its description.
        indices: index in a row by place of the group.
    """
    found = []
    for number, length in enumerate(robot.section_lengths):
        place = _PLACES * number
        curved = place + _BEND not in indices
        bend = indices.get(place + (_CURVATURE if curved else _BEND))
        if bend is None:
            return ()
        azimuth, column = indices.get(place + _AZIMUTH), indices.get(place + _LENGTH)
        found.append(SectionColumns(bend, azimuth, column, 0.0 if length.changes else length.rest_m, curved))
    return tuple(found)


def arc_names(robot: RobotDescription) -> list[str]:
    """The columns of bends that state a whole shape, in the order of `arc_values`."""
    return [name for name, meaning in arc_meanings(robot).items() if meaning.place % _PLACES != _CURVATURE]


def arc_values(robot: RobotDescription, arcs: Sequence[Sequence[float]]) -> list[float]:
    """Components and lengths as values of `arc_names`; a section that is straight by rounding bends to 0.

    Args:
        robot: its description.
        arcs: components u, v of the bend [rad] and length [m] of every section.
    """
    values = []
    for (u, v, length_m), length in zip(arcs, robot.section_lengths, strict=True):
        if robot.dimension == 3:
            bend = math.hypot(u, v)
            azimuth = math.atan2(v, u) if bend > _STRAIGHT_RAD else 0.0
            values += [Quantity.ANGLE.from_si(bend), Quantity.ANGLE.from_si(azimuth)]
        else:
            values.append(Quantity.ANGLE.from_si(u))
        if length.changes:
            values.append(Quantity.LENGTH.from_si(length_m))
    return values
