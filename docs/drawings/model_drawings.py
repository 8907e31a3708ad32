"""Draw one robot of every model, from the side and in section: ``python -m docs.drawings.model_drawings``.

Shapes come from the kinematics of the shipped robot files, dimensions from the files.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from contid import Robot
from contid.kinematics.model import Bending, build_model
from contid.robot_file.load import load_named
from contid_ropes.catenary import hang
from docs.drawings.plane_drawing import AXIS, BODY, SIZE, Drawing
from docs.drawings.robot_drawings import azimuth_deg, offset
from docs.drawings.svg import Point, write_drawings

WIDTH, HEIGHT = 430, 250
#: Pixels of the base of the side view, of the centre of the section, and of the radius of the section.
SIDE: Point = (110, 205)
SECTION: Point = (325, 125)
RADIUS_PX = 55.0


def backbone(robot: Any, bends_deg: Sequence[float], lengths_mm: Sequence[float] = ()) -> Any:
    """The x-z plane of a robot whose sections bend towards +x."""
    model = build_model(robot)
    assert isinstance(model, Bending)
    lengths = lengths_mm or [0.0] * len(bends_deg)
    arcs = [
        v for bend, mm in zip(bends_deg, lengths, strict=True) for v in (math.radians(bend), 0.0, mm / 1e3)
    ]
    found = 1e3 * model.shape(model.of_arcs(arcs, robot.rest), 241)
    return found[:, [0, 1]] if robot.dimension == 2 else found[:, [0, 2]]


def side(d: Drawing, along: Any, height_mm: float, up: bool = True) -> None:
    """Place the side view, which has this height, and draw the base."""
    scale = 150.0 / height_mm
    d.view(SIDE if up else (SIDE[0], 60.0), scale, up)
    d.line([along[0] - [45 / scale, 0], along[0] + [45 / scale, 0]], "black", 3)


def drives(d: Drawing, part: Any, distance_mm: float, ends: bool = True) -> None:
    """What runs beside a part of the backbone, and the plates at its ends."""
    for where in (-distance_mm, distance_mm):
        d.line(offset(part, where), AXIS, 2.5)
    d.line(part, BODY, 1.5, "4 3")
    for piece in (part[:2], part[-2:]) if ends else ():
        d.line([offset(piece, -1.15 * distance_mm)[-1], offset(piece, 1.15 * distance_mm)[-1]], BODY, 3)


def section(d: Drawing, azimuths_deg: Sequence[float], text: str, size: float = 0.1) -> None:
    """The section seen from the tip: drives around the backbone."""
    d.view(SECTION, RADIUS_PX)
    d.circle([0, 0], 1.0, BODY)
    d.circle([0, 0], 0.04, BODY, BODY)
    for angle in np.radians(azimuths_deg):
        d.circle([math.cos(angle), math.sin(angle)], size, AXIS, AXIS)
    d.note((SECTION[0], 225), text, SIZE, anchor="middle")


def rack_finger() -> Drawing:
    """A planar finger between two racks."""
    robot: Any = load_named("finger").file.robots["finger"]
    d = Drawing("rack_finger: two racks, one plane", WIDTH, HEIGHT)
    along = backbone(robot, [55], [70])
    side(d, along, 105)
    bent = along[: round(241 * 70 / (70 + robot.geometry.tip_length_mm))]
    drives(d, bent, robot.geometry.rack_spacing_mm / 2)
    d.line([bent[-1], along[-1]], BODY, 6)
    section(d, [0, 180], "2 lengths: left, right", 0.16)
    return d


def sections(
    name: str, title: str, bends_deg: Sequence[float], lengths_mm: Sequence[float], radius: Any
) -> Drawing:
    """An arm of lengths in threes: racks or tubes."""
    ((_, robot),) = load_named(name).file.robots.items()
    d = Drawing(title, WIDTH, HEIGHT)
    along = backbone(robot, bends_deg, lengths_mm)
    rigid = list(getattr(robot, "rigid_m", [0.0] * len(lengths_mm)))
    total = sum(lengths_mm) + 1e3 * sum(rigid)
    side(d, along, 1.05 * total)
    at = 0.0
    for length, gap, distance in zip(lengths_mm, rigid, radius, strict=True):
        ends = [round(240 * value / total) for value in (at, at + length, at + length + 1e3 * gap)]
        drives(d, along[ends[0] : ends[1] + 1], distance)
        if ends[2] > ends[1]:
            d.line(along[ends[1] : ends[2] + 1], BODY, 6)
        at += length + 1e3 * gap
    arm = Robot(name)
    section(d, [azimuth_deg(arm, k) for k in range(3)], "3 lengths a section", 0.13)
    return d


def tri_rack() -> Drawing:
    """An arm of racks."""
    geometry: Any = load_named("trirack2").file.robots["arm"].geometry
    title = "tri_rack: three racks a section, each through all of them"
    return sections("trirack2", title, [45, -25], [230, 190], [geometry.rack_radius_mm] * 2)


def tri_tube() -> Drawing:
    """An arm of tubes that lengthen."""
    geometry: Any = load_named("cbha").file.robots["cbha"].geometry
    return sections(
        "cbha", "tri_tube: three tubes a section that lengthen", [35, 20], [125, 105], geometry.radius_mm
    )


def tendon() -> Drawing:
    """An arm of tendons on a backbone of one length."""
    robot: Any = load_named("tendon3").file.robots["arm"]
    d = Drawing("tendon: pulled by tendons, of one length", WIDTH, HEIGHT)
    along = backbone(robot, [35, 25, -30])
    side(d, along, 330)
    distance = max(robot.geometry.sections[0].radius_mm)
    for where in (-distance, distance):
        d.line(offset(along, where), AXIS, 1.5)
    d.line(along, BODY, 3)
    for at in range(0, 241, 16):
        piece = along[max(at - 1, 0) : max(at - 1, 0) + 2]
        d.line([offset(piece, -1.3 * distance)[0], offset(piece, 1.3 * distance)[0]], BODY, 2)
    first = robot.geometry.sections[0].angles_deg
    section(d, first, f"{len(first)} pulls a section, 3 or more", 0.07)
    return d


def coupled() -> Drawing:
    """A trunk whose motors wind one tendon in and pay out the one that faces it."""
    robot: Any = load_named("trunk").file.robots["arm"]
    d = Drawing("drives: a motor for two tendons that face each other", WIDTH, HEIGHT)
    along = backbone(robot, [15, 30, 45])
    side(d, along, 330, up=False)
    distance = robot.geometry.sections[0].radius_mm[0]
    drives(d, along, distance, ends=False)
    for at in (80, 160, 240):
        piece = along[at - 1 : at + 1]
        d.line([offset(piece, -1.2 * distance)[-1], offset(piece, 1.2 * distance)[-1]], BODY, 3)
    each = robot.geometry.sections
    section(d, [angle for one in each for angle in one.angles_deg], "6 drives for 12 tendons", 0.07)
    for drive in robot.drives.values():
        names = [name.split(".") for name in drive.pulls]
        ends = [math.radians(each[int(s[1:]) - 1].angles_deg[int(t[1:]) - 1]) for s, t in names]
        d.line(np.array([[0.86 * math.cos(end), 0.86 * math.sin(end)] for end in ends]), AXIS, 1, "3 4")
    return d


def cosserat() -> Drawing:
    """A soft arm of chambers, hanging."""
    robot: Any = load_named("stiffflop2").file.robots["arm"]
    one = robot.geometry.sections[0]
    d = Drawing("cosserat: silicone with chambers, bends under load", WIDTH, HEIGHT)
    along = Robot("stiffflop2").backbone([0.05, 0.45, 0.45, 0.05, 0.35, 0.35], 241)[:, [0, 2]]
    side(d, along, 115, up=False)
    for where in (-one.radius_mm, one.radius_mm):
        d.line(offset(along, where), BODY, 2)
    for where in (-one.chamber_placement_mm, one.chamber_placement_mm):
        d.line(offset(along, where), AXIS, 5)
    d.view(SECTION, RADIUS_PX / one.radius_mm)
    d.circle([0, 0], one.radius_mm)
    d.circle([0, 0], one.channel_radius_mm)
    for pair in range(3):
        for half in (-0.5, 0.5):
            angle = math.radians(one.first_pair_deg + 120.0 * pair + half * one.pair_angle_deg)
            at = one.chamber_placement_mm * np.array([math.cos(angle), math.sin(angle)])
            d.circle(at, one.chamber_radius_mm, AXIS, AXIS)
    d.note((SECTION[0], 225), "3 pressures a section", SIZE, anchor="middle")
    return d


def chain() -> Drawing:
    """Two arms that hold a rope."""
    robots: Any = load_named("chain").file.robots
    rope = next(link.rope for link in robots["rope"].links if link.rope is not None)
    d = Drawing("chain: two arms and what hangs between them", WIDTH, HEIGHT)
    d.view((90, 150), 0.36)
    arms, tips = Robot("chain"), {}
    for name, actuation in {"left": [120, 132, 132, 112, 118, 118], "right": [125] * 3 + [115] * 3}.items():
        along = arms[name].backbone(actuation, 201)[:, [0, 2]]
        distance = robots[name].geometry.radius_mm[0]
        drives(d, along, distance, ends=False)
        d.line([along[0] - [90, 0], along[0] + [90, 0]], "black", 3)
        tips[name] = arms[name].fk(actuation).tip
    hanging = hang(tips["left"] / 1e3, tips["right"] / 1e3, rope.length_mm / 1e3)
    assert hanging is not None
    d.line(1e3 * np.asarray(hanging.points(81))[:, [0, 2]], BODY, 2.5)
    d.note((215, 225), "the axes of both arms", SIZE, anchor="middle")
    return d


DRAWINGS = {
    f"models/{draw.__name__}.svg": draw
    for draw in (rack_finger, tri_rack, tri_tube, tendon, coupled, cosserat, chain)
}


if __name__ == "__main__":
    write_drawings(DRAWINGS)
