"""Columns of a trajectory: names to robots, quantities and SI.

A column is ``ROBOT.QUANTITY``; the robot's name may be left out when only one robot has the quantity.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import Final

from contid.errors import BadInputError, Located
from contid.robot_file.robot import RobotDescription
from contid.targets import ZERO3, Target, Vec3, frame_of_axes, unit_vector
from contid.trajectory.arc_columns import (
    GROUP,
    SectionColumns,
    arc_meanings,
    doubled_arcs,
    missing_arcs,
    section_columns,
)
from contid.trajectory.meaning import Meaning
from contid.trajectory.surface_columns import SurfaceColumns, is_on_surface, surface_columns
from contid.units import MM_PER_M

TIME: Final = "t_s"
#: How many of the unit of a column make one of another unit that tables have.
_UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "s": {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "sec": 1.0, "seconds": 1.0, "min": 60.0},
    "mm": {"m": 1e3, "cm": 10.0, "um": 1e-3, "in": 25.4, "inch": 25.4},
    "deg": {"rad": 180.0 / math.pi},
    "bar": {"pa": 1e-5, "kpa": 1e-2, "mpa": 10.0, "psi": 0.0689475729, "mbar": 1e-3, "atm": 1.01325},
    "n": {"mn": 1e-3, "kn": 1e3},
}
_AXES: Final = ("x", "y", "z")
#: A header with more mistakes is another file; the search for the nearest name takes a millisecond each.
MAX_FINDINGS: Final = 20
#: From this number of unknown columns on, and most of all, a table is one of another program: one finding.
MIN_FOREIGN: Final = 4


def vocabulary(robot: RobotDescription) -> dict[str, Meaning]:
    """Every column of a robot, without its name in front."""
    known: dict[str, Meaning] = {}
    axes = _AXES[: robot.dimension]
    positions = (("tip", "", "tip"), ("mid", "mid.", "mid"), ("tip", "meas.", "measured"))
    for accepted, prefix, group in positions:
        if accepted in robot.accepts:
            for place, axis in enumerate(axes):
                known[f"{prefix}{axis}_mm"] = Meaning(group, place, divisor=1e3)
    if "tip" in robot.accepts:
        # Trackers may measure a direction that the robot cannot be commanded to.
        known.update(
            {f"meas.a{axis}": Meaning("measured_direction", place) for place, axis in enumerate(axes)}
        )
    if "direction" in robot.accepts:
        known.update({f"a{axis}": Meaning("direction", place) for place, axis in enumerate(axes)})
    if "rotation" in robot.accepts:
        known.update({f"b{axis}": Meaning("x_axis", place) for place, axis in enumerate(axes)})
    if "load" in robot.accepts:
        known.update({f"load.f{axis}_n": Meaning("load", place) for place, axis in enumerate(axes)})
    if "arcs" in robot.accepts:
        known.update(arc_meanings(robot))
    own = len(robot.axis_names)
    for place, (column, quantity) in enumerate(zip(robot.columns, robot.quantities, strict=True)):
        divisor, factor = quantity.edge_si
        if place >= own:
            known[column] = Meaning("extra", place - own, factor, divisor)
        elif "actuation" in robot.accepts:
            known[column] = Meaning("actuation", place, factor, divisor)
    return known


def column_groups(prefix: str, robot: RobotDescription) -> dict[str, list[str]]:
    """The columns of a robot by kind of target.

    Args:
        prefix: in front of each name: ``"left."``, or ``""`` for a single robot.
        robot: its description.
    """
    found: dict[str, list[str]] = {}
    for name, meaning in vocabulary(robot).items():
        found.setdefault(meaning.group, []).append(f"{prefix}{name}")
    return {each.name: found[each.name] for each in fields(RobotColumns) if each.name in found}


@dataclass(frozen=True, slots=True)
class RobotColumns:
    """Indices in a row of the quantities of one robot, in the order of the group."""

    robot: str
    tip: tuple[int, ...] = ()
    direction: tuple[int, ...] = ()
    x_axis: tuple[int, ...] = ()
    mid: tuple[int, ...] = ()
    load: tuple[int, ...] = ()
    actuation: tuple[int, ...] = ()
    arcs: tuple[SectionColumns | SurfaceColumns, ...] = ()
    extra: tuple[tuple[str, int], ...] = ()
    measured: tuple[int, ...] = ()
    measured_direction: tuple[int, ...] = ()

    @property
    def moving(self) -> tuple[int, ...]:
        """Indices of the quantities that command motion; the others are inputs: loads, measurements."""
        tip = (*self.tip, *self.direction, *self.x_axis, *self.mid)
        arcs = (index for section in self.arcs for index in section.moving)
        return (*tip, *self.actuation, *arcs, *(index for _, index in self.extra))

    def target(self, row: Sequence[float]) -> Target:
        """The target of this robot in a row of SI values; its direction becomes a unit vector.

        With an x axis the target has the frame instead; the part of that axis across the direction counts.
        """
        turn = self.rotation(row) if self.x_axis else None
        return Target(
            tip_m=_vector(row, self.tip) if self.tip else None,
            direction=(
                unit_vector(_vector(row, self.direction)) if self.direction and turn is None else None
            ),
            rotation=turn,
            mid_m=_vector(row, self.mid) if self.mid else None,
            actuation=tuple([row[index] for index in self.actuation]) if self.actuation else None,
            arcs=tuple([each for section in self.arcs for each in section.arc(row)]) if self.arcs else None,
            load_n=_vector(row, self.load) if self.load else ZERO3,
            extra={name: row[index] for name, index in self.extra},
            measured_tip_m=_vector(row, self.measured) if self.measured else None,
            measured_direction=(
                unit_vector(_vector(row, self.measured_direction)) if self.measured_direction else None
            ),
        )

    def resolve(self, row: list[float]) -> None:
        """Replace the angles of bends in a row of SI values by components (`SectionColumns.resolve`)."""
        for section in self.arcs:
            section.resolve(row)

    def rotation(self, row: Sequence[float]) -> tuple[float, ...] | None:
        """The tip's frame in a row that has its x axis; None where that is parallel to the direction."""
        return frame_of_axes(_vector(row, self.direction), _vector(row, self.x_axis))


@dataclass(frozen=True, slots=True)
class ColumnLayout:
    """The meaning of every column of one trajectory.

    Attributes:
        names: the columns as written, in file order.
        time: index of ``t_s``, or None for a stream.
        factors, divisors: from each column to SI.
        robots: one entry per robot that has columns.
    """

    names: tuple[str, ...]
    time: int | None
    factors: tuple[float, ...]
    divisors: tuple[float, ...]
    robots: tuple[RobotColumns, ...]

    def moved_mm(self, targets: Mapping[str, Target]) -> dict[str, float]:
        """The columns of tips, and of lengths of sections, with their values in targets [mm]."""
        found: dict[int, float] = {}
        for columns in self.robots:
            target = targets.get(columns.robot)
            if target is None:
                continue
            found |= zip(columns.tip, target.tip_m or (), strict=False)
            lengths = zip(columns.arcs, (target.arcs or ())[2::3], strict=False)
            found |= {each.length: length_m for each, length_m in lengths if each.length is not None}
        return {self.names[index]: value * MM_PER_M for index, value in found.items()}

    def targets(self, row: Sequence[float]) -> dict[str, Target]:
        """Targets by robot of one row of SI values, in the world frame."""
        return {columns.robot: columns.target(row) for columns in self.robots}


def read_layout(
    names: Sequence[tuple[str, int]], file: str, line: int, robots: Mapping[str, RobotDescription]
) -> ColumnLayout:
    """Interpret a header.

    Args:
        names: each column's name and its position in the line (from 1).
        file: name of the source in messages.
        line: line of the header.
        robots: descriptions by name.

    Raises:
        BadInputError: unknown, ambiguous, duplicate, missing or contradicting columns; the first
            `MAX_FINDINGS` findings.
    """
    vocabularies = {robot: vocabulary(description) for robot, description in robots.items()}
    findings: list[Located] = []
    foreign = _foreign(names, vocabularies)
    seen: dict[tuple[str, str, int], tuple[int, str]] = {}
    factors, divisors = [1.0] * len(names), [1.0] * len(names)
    for index, (name, column) in enumerate(names):
        if len(findings) == MAX_FINDINGS:
            raise BadInputError(findings)
        owner, message = _owner(name, vocabularies)
        if message:
            if foreign and len(names) >= MIN_FOREIGN:
                raise BadInputError([Located(file, line, column, f"{message}; {foreign}")])
            findings.append(Located(file, line, column, message))
            continue
        meaning = Meaning("time", 0) if name == TIME else vocabularies[owner][name.removeprefix(f"{owner}.")]
        key = (owner, meaning.group, meaning.place)
        if key in seen:
            twice = f"column {name!r} repeats column {seen[key][1]!r}"
            findings.append(Located(file, line, column, twice))
            continue
        seen[key] = (index, name)
        factors[index], divisors[index] = meaning.factor, meaning.divisor
    groups = []
    for robot, known in vocabularies.items():
        mine = {key[1:]: index for key, (index, _) in seen.items() if key[0] == robot}
        if mine:
            first = names[min(mine.values())][1]
            findings += [
                Located(file, line, first, message)
                for message in _gaps(robots[robot], robot, known, mine, vocabularies)
            ]
            groups.append(_group(robot, robots[robot], mine))
    if not groups and not findings:
        findings.append(Located(file, line, 1, f"no column moves a robot; {_choices(vocabularies)}"))
    if findings:
        findings.sort(key=lambda found: found.column)
        if foreign:
            last = findings.pop()
            findings.append(Located(file, line, last.column, f"{last.message}; {foreign}"))
        raise BadInputError(findings)
    time = seen.get(("", "time", 0))
    names_only = tuple(name for name, _ in names)
    return ColumnLayout(names_only, time[0] if time else None, tuple(factors), tuple(divisors), tuple(groups))


def _foreign(names: Sequence[tuple[str, int]], vocabularies: Mapping[str, Mapping[str, Meaning]]) -> str:
    """What to do with the table of another program, which one finding names; "" for a table with mistakes."""
    known = {TIME, *(name for own in vocabularies.values() for name in own)}
    known |= {f"{robot}.{name}" for robot, own in vocabularies.items() for name in own}
    unknown = sum(name not in known for name, _ in names)
    if unknown < len(names) and (unknown < MIN_FOREIGN or 2 * unknown <= len(names)):
        return ""
    what = "columns are" if unknown > 1 else "column is"
    return f"{unknown} {what} unknown: contid adapt FILE --for ROBOT reads the tables of other programs"


def _owner(name: str, vocabularies: Mapping[str, Mapping[str, Meaning]]) -> tuple[str, str]:
    """The robot a column belongs to ("" for the time), or a message."""
    if name == TIME:
        return "", ""
    for robot, known in vocabularies.items():
        if name.startswith(f"{robot}.") and name.removeprefix(f"{robot}.") in known:
            return robot, ""
    owners = [robot for robot, known in vocabularies.items() if name in known]
    if len(owners) == 1:
        return owners[0], ""
    if owners:
        choices = " or ".join(f"{robot}.{name}" for robot in owners)
        return "", f"column {name!r} could belong to {len(owners)} robots; write {choices}"
    if not name:
        return "", "a column has no name"
    return "", f"unknown column {name[:60]!r}{_format_hint(name)}; {_choices(vocabularies, name[:60])}"


def _format_hint(name: str) -> str:
    """A hint at the usual mistakes of programs that write tables."""
    if "\0" in name or "\ufffd" in name:
        return " (is this UTF-8 text? save it as CSV in UTF-8)"
    if {";", "\t"} & {*name}:
        return (
            " (columns are separated by commas, not by semicolons or tabs; contid adapt reads other tables)"
        )
    with suppress(ValueError):
        float(name)
        return " (a number: the header is missing; the first line names the columns)"
    return ""


def _choices(vocabularies: Mapping[str, Mapping[str, Meaning]], wrong: str = "") -> str:
    alone = len(vocabularies) == 1
    full = [f"{robot}.{name}" for robot, known in vocabularies.items() for name in known]
    names = [TIME, *(name for known in vocabularies.values() for name in known)] if alone else [TIME, *full]
    # Without its unit, `x`, or in capitals a name has too few letters in common with `x_mm` for difflib.
    near = [name for name in [*names, *full] if wrong and wrong.casefold() in (name.rpartition("_")[0], name)]
    if other := _other_unit(wrong, [*names, *full]):
        return f"allowed: {', '.join(names)}; {other}"
    near = near or difflib.get_close_matches(wrong, [*names, *full], n=1)
    return f"allowed: {', '.join(names)}" + (f"; did you mean {near[0]!r}?" if near else "")


def _other_unit(wrong: str, names: Sequence[str]) -> str:
    """The factor to a column with the same stem and another unit; "" for none."""
    stem, _, unit = wrong.rpartition("_")
    for name in names:
        mine, _, own = name.rpartition("_")
        if mine == stem and unit != own and (factor := _UNITS.get(own, {}).get(unit.lower())):
            return f"for {name!r} multiply the numbers by {factor:.9g} ({unit} to {own})"
    return ""


def _gaps(
    description: RobotDescription,
    robot: str,
    known: Mapping[str, Meaning],
    mine: Mapping[tuple[str, int], int],
    vocabularies: Mapping[str, object],
) -> Iterable[str]:
    """Missing and contradicting columns of a robot."""
    prefix = f"{robot}." if len(vocabularies) > 1 else ""
    groups = {group for group, _ in mine}
    for group in sorted(groups - {"extra"}):
        places = {place for each, place in mine if each == group}
        members = {name: meaning for name, meaning in known.items() if meaning.group == group}
        given = [name for name, meaning in members.items() if meaning.place in places]
        lacks = [name for name in members if name not in given]
        if group == GROUP:
            lacks = missing_arcs(description, places)
        elif group == "tip" and is_on_surface(description, places):
            lacks = []
        if lacks:
            missing = ", ".join(repr(prefix + name) for name in lacks)
            yield f"column {prefix + given[0]!r} needs {missing} beside it"
        for section in doubled_arcs(description, places) if group == GROUP else ():
            yield f"robot {robot!r} has the bend and the curvature of {section}; allowed is one of them"
    kinds = [kind for kind in ("tip", "actuation", GROUP) if kind in groups]
    if len(kinds) > 1:
        yield f"robot {robot!r} has {' and '.join(kinds)} columns; allowed is one of them"
    elif not kinds:
        yield f"robot {robot!r} has columns, but neither its tip nor its actuation"
    elif "tip" not in kinds and groups & {"direction", "x_axis", "mid"}:
        yield f"robot {robot!r} has {kinds[0]} columns; a direction or mid-point goes with a tip only"
    if "x_axis" in groups and "direction" not in groups:
        yield f"robot {robot!r} has the x axis of its tip (bx, ...), but no direction (ax, ay, az)"
    if {"x_axis", "mid"} <= groups:
        yield f"robot {robot!r} has the x axis of its tip and a mid-point; allowed is one of them"
    if "measured_direction" in groups and "measured" not in groups:
        yield f"robot {robot!r} has a measured direction, but no measured tip (meas.x_mm, ...)"


def _group(robot: str, description: RobotDescription, mine: Mapping[tuple[str, int], int]) -> RobotColumns:
    names = description.extra_axis_names
    groups: dict[str, tuple[int, ...]] = {}
    extra: tuple[tuple[str, int], ...] = ()
    for (group, place), index in sorted(mine.items()):
        if group == "extra":
            extra = (*extra, (names[place], index))
        elif group != GROUP:
            groups[group] = (*groups.get(group, ()), index)
    if is_on_surface(description, {place for group, place in mine if group == "tip"}):
        on_surface = surface_columns(description, *groups.pop("tip"))
        return RobotColumns(robot, extra=extra, arcs=(on_surface,), **groups)
    arcs = section_columns(
        description, {place: index for (group, place), index in mine.items() if group == GROUP}
    )
    return RobotColumns(robot, extra=extra, arcs=arcs, **groups)


def _vector(row: Sequence[float], indices: tuple[int, ...]) -> Vec3:
    """Three components from two or three columns; planar robots leave z at 0."""
    z = row[indices[2]] if len(indices) == 3 else 0.0
    return (row[indices[0]], row[indices[1]], z)
