"""What a body is made of: cylinders between stations of the backbone, for every kind of robot.

A station is a place along a section, from 0 (its beginning) to 1. Offsets are in the frame there: across (x),
across (y) and along the backbone, in mm. The plan of a robot never changes; `contid_view.body` places it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from contid.robot_file.cosserat import Cosserat
from contid.robot_file.rack_finger import RackFinger
from contid.robot_file.robot import RobotDescription
from contid.robot_file.sections import SectionRobot
from contid.robot_file.tendon.robot import TendonRobot
from contid.robot_file.tri_tube import TriTube
from contid.units import MM_PER_M
from contid_view.tendon_lines import DISCS, RIM

#: Radius of a body whose file has none, as a fraction of its length.
SLENDERNESS: Final = 0.035
#: Cylinders along a section of a tube or rack, and ribs of a bellows.
PIECES: Final = 8
RIBS: Final = 7
#: Rods across a finger, from rack to rack.
LINKS: Final = 14
#: Neighbouring cylinders overlap by this share of their radius, so that a bent tube has no wedges.
OVERLAP: Final = 0.12

Offset = tuple[float, float, float]
_ON_LINE: Final[Offset] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class BodyPart:
    """One cylinder.

    Attributes:
        begin, end: stations of its ends, ``section + share``.
        from_mm, to_mm: offsets of its ends in the frames there.
        radius_mm: radius of the cylinder.
        shade: 0 for the body, 1 for its second colour, 2 for platforms, discs and links.
    """

    begin: float
    end: float
    from_mm: Offset
    to_mm: Offset
    radius_mm: float
    shade: int


def body_plan(robot: RobotDescription, length_mm: float) -> tuple[BodyPart, ...]:
    """The parts of a robot.

    Args:
        robot: its description; a model that contid does not have gets a plain tube.
        length_mm: length of its backbone, the scale of what the file has no dimension for.
    """
    if isinstance(robot, RackFinger):
        return tuple(_finger(robot))
    if isinstance(robot, SectionRobot):
        return tuple(_section_robot(robot))
    if isinstance(robot, Cosserat):
        return tuple(_pneumatic(robot))
    if isinstance(robot, TendonRobot):
        return tuple(_tendon(robot))
    radius = SLENDERNESS * length_mm
    return (*_tube(0, 2 * PIECES, _ON_LINE, radius, 0), _disc(0.0, 1.5 * radius, 0.5 * radius))


def section_shares(robot: RobotDescription, actuation: Sequence[float]) -> tuple[float, ...]:
    """Ends of the sections as shares of the backbone, 0 first and 1 last.

    Of a finger the tip body is a section too, and of a tendon robot the pieces before its first section and
    behind its last one.
    """
    if isinstance(robot, SectionRobot):
        lengths = [
            sum(actuation[3 * s : 3 * s + 3]) / 3.0 + rigid
            for s, rigid in zip(range(robot.sections), robot.rigid_m, strict=True)
        ]
    elif isinstance(robot, Cosserat):
        lengths = [each.length_mm + each.link_mm for each in robot.geometry.sections]
    elif isinstance(robot, TendonRobot):
        geometry = robot.geometry
        sections = [each.length_mm + each.rigid_mm for each in geometry.sections]
        lengths = [geometry.base_offset_mm, *sections, math.hypot(*geometry.tip_offset_mm)]
    elif isinstance(robot, RackFinger):
        lengths = [sum(actuation[:2]) / 2.0, robot.geometry.tip_length_mm / MM_PER_M]
    else:
        lengths = [1.0]
    total = math.fsum(lengths)
    ends = [0.0]
    for length in lengths:
        ends.append(ends[-1] + length / total)
    return (*ends[:-1], 1.0)


def _finger(robot: RackFinger) -> Iterator[BodyPart]:
    """Two racks, the links between them, and the tip body (section 1, without length if there is none)."""
    half = 0.5 * robot.geometry.rack_spacing_mm
    rack = 0.22 * half
    for side in (-half, half):
        yield from _tube(0, 2 * PIECES, (side, 0.0, 0.0), rack, 0)
    for k in range(1, LINKS):
        at = k / LINKS
        yield BodyPart(at, at, (-half, 0.0, 0.0), (half, 0.0, 0.0), 0.5 * rack, 2)
    yield BodyPart(1.0, 1.0, (-half - rack, 0.0, 0.0), (half + rack, 0.0, 0.0), 1.3 * rack, 2)
    yield BodyPart(0.0, 0.0, (-half - 2 * rack, 0.0, 0.0), (half + 2 * rack, 0.0, 0.0), 1.6 * rack, 2)
    if robot.geometry.tip_length_mm:
        yield BodyPart(1.0, 2.0, _ON_LINE, _ON_LINE, 0.45 * half, 1)


def _section_robot(robot: SectionRobot) -> Iterator[BodyPart]:
    """Three racks or bellows per section, and the platforms that hold them."""
    bellows = isinstance(robot, TriTube)
    radii = [MM_PER_M * radius for radius in robot.radius_m]
    for section, (radius, rigid_m) in enumerate(zip(radii, robot.rigid_m, strict=True)):
        tube = 0.72 * radius if bellows else 0.12 * radius
        for angle_deg in robot.tube_angles_deg[section]:
            angle = math.radians(angle_deg)
            offset = (radius * math.cos(angle), radius * math.sin(angle), 0.0)
            if bellows:
                yield from _bellows(section, offset, tube, section % 2)
            else:
                yield from _tube(section, PIECES, offset, tube, section % 2)
        thick = max(MM_PER_M * rigid_m, 0.12 * radius)
        yield _disc(float(section + 1), radius + 1.3 * tube, thick)
    yield _disc(0.0, 1.15 * (radii[0] + 1.3 * tube), 0.2 * radii[0])


def _pneumatic(robot: Cosserat) -> Iterator[BodyPart]:
    """One silicone body per section, with a flange at its end."""
    for section, part in enumerate(robot.geometry.sections):
        yield from _tube(section, PIECES + 4, _ON_LINE, part.radius_mm, section % 2)
        yield _disc(float(section + 1), 1.06 * part.radius_mm, max(part.link_mm, 0.15 * part.radius_mm))
    first = robot.geometry.sections[0].radius_mm
    yield _disc(0.0, 1.3 * first, 0.4 * first)


def _tendon(robot: TendonRobot) -> Iterator[BodyPart]:
    """A rod with discs; the tendons themselves are drawn as lines. Section 0 is before the first disc."""
    geometry = robot.geometry
    rim = RIM * max(max(section.radius_mm) for section in geometry.sections)
    rod, last = 0.18 * rim, 1 + len(geometry.sections)
    for section in range(1, last):
        yield from _tube(section, PIECES, _ON_LINE, rod, (section - 1) % 2)
        for k in range(1, DISCS + 1):
            thick = 0.16 * rim if k < DISCS else 0.3 * rim
            yield _disc(section + k / DISCS, rim, thick)
    yield _disc(1.0, 1.2 * rim, 0.35 * rim)
    if geometry.base_offset_mm:
        yield BodyPart(0.0, 1.0, _ON_LINE, _ON_LINE, rod, 0)
    if any(geometry.tip_offset_mm):
        yield BodyPart(float(last), last + 1.0, _ON_LINE, _ON_LINE, rod, 0)


def _tube(section: int, pieces: int, offset: Offset, radius: float, shade: int) -> Iterator[BodyPart]:
    x, y, _ = offset
    lap = OVERLAP * radius
    for k in range(pieces):
        begin, end = section + k / pieces, section + (k + 1) / pieces
        yield BodyPart(begin, end, (x, y, -lap), (x, y, lap), radius, shade)


def _bellows(section: int, offset: Offset, radius: float, shade: int) -> Iterator[BodyPart]:
    """Ribs with grooves between them."""
    yield from _tube(section, PIECES // 2, offset, 0.8 * radius, 2)
    for k in range(RIBS):
        begin, end = section + (k + 0.14) / RIBS, section + (k + 0.86) / RIBS
        yield BodyPart(begin, end, offset, offset, radius, shade)


def _disc(station: float, radius: float, thick_mm: float) -> BodyPart:
    """A plate that ends at a station, or begins there at the base."""
    return BodyPart(station, station, (0.0, 0.0, -thick_mm), _ON_LINE, radius, 2)
