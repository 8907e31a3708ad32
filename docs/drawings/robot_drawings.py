"""Draw axes, frames and dimensions of the papers' robots: ``python -m docs.drawings.robot_drawings``.

Shapes and azimuths come from the kinematics of the shipped robot files, dimensions from the files.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from contid import Robot
from contid.robot_file.load import load_named
from contid_ropes.catenary import hang
from docs.drawings.plane_drawing import AXIS, BODY, FRAME, SIZE, Drawing
from docs.drawings.svg import Point, write_drawings


def offset(points: Any, distance: float) -> Any:
    """The line beside a line of the plane, to its right."""
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    return points + distance * np.column_stack([along[:, 1], -along[:, 0]])


def azimuth_deg(robot: Robot, column: int) -> float:
    """Azimuth of an axis by the model: with more of it alone the straight arm bends away from it."""
    middle = (robot.limits.min + robot.limits.max) / 2
    more = middle.copy()
    more[column] += 0.01 * (robot.limits.max - robot.limits.min)[column]
    lean = (robot.fk(more).tip - robot.fk(middle).tip)[:2]
    return float(np.degrees(np.arctan2(-lean[1], -lean[0])))


def outer_side(finger: Robot, column: int) -> float:
    """Side of a rack by the model, 1 on the world's +x: longer alone it bends the finger away from it."""
    racks = np.array([60.0, 60.0])
    racks[column] += 5.0
    return -float(np.sign(finger.fk(racks).tip[0] - finger.fk([60.0, 60.0]).tip[0]))


def rack_hand() -> Drawing:
    """The hand of two rack fingers, in its plane."""
    hand = Robot("hand")
    geometry: Any = load_named("hand").file.robots["left"].geometry
    d = Drawing("hand: two rack fingers in the plane; finger is the left one alone", 760, 420)
    d.view((180, 350), 2.6)
    rows = {"left": [62, 78], "right": [70, 70]}
    for name, actuation in rows.items():
        finger = hand[name]
        along = finger.backbone(actuation, 81)
        tip = finger.fk(actuation).tip
        total = float(np.mean(actuation)) + geometry.tip_length_mm
        bent = along[: int(np.ceil(81 * np.mean(actuation) / total))]
        mirror = -1.0 if name == "right" else 1.0
        for column, axis in enumerate(finger.axes):
            side = outer_side(finger, column)
            rack = offset(bent, side * geometry.rack_spacing_mm / 2)
            d.line(rack, AXIS, 2.5)
            d.label(rack[14], f"{name}.{axis}", AXIS, (10 * side, 0), "start" if side > 0 else "end")
        d.line(along, BODY, 1.5, "4 3")
        d.line([bent[-1], tip], BODY, 6)
        d.circle(tip, 1.8, BODY, BODY)
        d.label(tip, "tip", BODY, (8, -6))
        base = along[0]
        d.line([base - np.array([16, 0]), base + np.array([16, 0])], "black", 3)
        if name == "left":
            d.size(
                bent[-1] + [-14, 0],
                tip + np.array([-14, 0]),
                f"tip_length_mm {geometry.tip_length_mm:g}",
                (-8, 4),
                "end",
            )
            w = geometry.rack_spacing_mm / 2
            d.line([base - np.array([w, 14]), base + np.array([-w, 0])], SIZE, 0.7)
            d.line([base + np.array([w, -14]), base + np.array([w, 0])], SIZE, 0.7)
            d.size(
                base - np.array([w, 12]),
                base + np.array([w, -12]),
                f"rack_spacing_mm {geometry.rack_spacing_mm:g}",
                (-24, 18),
                "end",
            )
            d.line([base, base + np.array([0, 105])], SIZE, 0.8, "2 3")
            d.label([0, 0], "theta: bend, positive to +x", SIZE, (8, -278))
        d.frame(
            base,
            [mirror, 0],
            [0, 1],
            ("x", "y", f"base of {name}" if name == "right" else "world, base of left"),
            34,
        )
    d.size([0, -18], [100, -18], "base.x_mm 100", (0, 16), "middle")
    x = 540
    for i, text in enumerate(
        (
            "dashed: backbone, an arc",
            "orange: racks; the longer one",
            "is on the outer side of the bend",
            "base.mirror_x: the right finger",
            "has its x axis reversed",
        )
    ):
        d.note((x, 60 + 17 * i), text)
    return d


def arm(
    name: str,
    actuation: list[float],
    scale: float,
    up: bool,
    radius_mm: list[float],
    gaps_mm: list[float],
    notes: tuple[str, ...],
    top: str,
    platform_below_mid: bool = True,
) -> Drawing:
    """A section arm bent in its x-z plane, and its axes around the backbone."""
    robot = Robot(name)
    unit = robot.axes[0].rsplit("_", 1)[1]
    d = Drawing(f"{name}: x-z plane of the base frame, and the axes {top}", 760, 430)
    origin: Point = (150, 370) if up else (150, 70)
    d.view(origin, scale, up)
    along = robot.backbone(actuation, 401)[:, [0, 2]]
    mid = robot.fk(actuation).mid[[0, 2]]
    step_mm = float(np.linalg.norm(np.diff(along, axis=0), axis=1).mean())
    first = int(np.argmin(np.linalg.norm(along - mid, axis=1)))
    rigid = [round(gap / step_mm) for gap in gaps_mm]
    # The mid-point has the platform of a rack arm below it, the link of a pneumatic arm after it.
    ends = [first + (0 if platform_below_mid else rigid[0]), 400]
    begin = 0
    for k, end in enumerate(ends):
        stop = end - rigid[k]
        part = along[begin : stop + 1]
        for side in (-radius_mm[k], radius_mm[k]):
            d.line(offset(part, side), AXIS, 2.5)
        d.line(part, BODY, 1.5, "4 3")
        for at in (begin, stop, end):
            piece = along[max(at - 1, 0) : max(at - 1, 0) + 2]
            d.line([offset(piece, -1.15 * radius_mm[k])[0], offset(piece, 1.15 * radius_mm[k])[0]], BODY, 3)
        if stop < end:
            d.line(along[stop : end + 1], BODY, 6)
            at = offset(along[stop : end + 1], 1.15 * radius_mm[k])[0]
            d.label(at, f"rigid {gaps_mm[k]:g} mm", SIZE, (10, -4))
        middle = offset(part, radius_mm[k])[len(part) // 2]
        d.label(middle, f"section {k + 1}: s{k + 1}", AXIS, (10, 4))
        begin = end
    length = 52 / scale
    d.frame([0, 0], [1, 0], [0, 1], ("x", "z", "base"), length)
    ahead = (along[-1] - along[-3]) / np.linalg.norm(along[-1] - along[-3])
    d.line([along[-1], along[-1] + length * ahead], FRAME, 2, ends="frame")
    d.label(along[-1] + 1.1 * length * ahead, "tip, direction", FRAME, (8, 4))
    d.label(mid, "mid", FRAME, (-1.3 * scale * radius_mm[0] - 6, 4), "end")
    d.view((560, 190), 90 / max(radius_mm), True)
    d.circle([0, 0], max(radius_mm), BODY)
    d.frame([0, 0], [1, 0], [0, 1], ("x", "y", ""), 1.3 * max(radius_mm))
    for i in range(3):
        angle = azimuth_deg(robot, i)
        at = max(radius_mm) * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        d.circle(at, 0.09 * max(radius_mm), AXIS, AXIS)
        label = robot.axes[i].split(".", 1)[1].rsplit("_", 1)[0]
        turned = round(angle) % 360
        shift = (0.0, -12.0) if at[1] > 0.3 * max(radius_mm) else (0.0, 24.0)
        if abs(at[1]) < 0.3 * max(radius_mm):
            shift = (-50.0, 4.0) if at[0] < 0 else (0.0, 24.0)
        d.label(at, f"{label}: {turned} deg", AXIS, shift, "middle")
    for k, radius in enumerate(radius_mm):
        end = np.array([np.cos(np.radians(30.0 - 60.0 * k)), np.sin(np.radians(30.0 - 60.0 * k))]) * max(
            radius_mm
        )
        if k == 0 or radius != radius_mm[0]:
            d.note((440, 330 + 17 * k), f"distance from the backbone, section {k + 1}: {radius:g} mm", SIZE)
        if k == 0:
            d.line([[0, 0], end], SIZE, 1, ends="size")
    for i, text in enumerate((f"columns: s1.*_{unit}, s2.*_{unit}", *notes)):
        d.note((440, 364 + 17 * i), text)
    return d


def trirack() -> Drawing:
    """The two-segment arm of three racks."""
    geometry: Any = load_named("trirack2").file.robots["arm"].geometry
    return arm(
        "trirack2",
        [270, 220, 220, 150, 180, 180],
        0.62,
        True,
        [geometry.rack_radius_mm] * 2,
        list(geometry.platform_mm),
        ("phi_deg: azimuth of rack 1; platform_mm: rigid pieces", "trirack: the first segment alone"),
        "seen from +z",
    )


def cbha() -> Drawing:
    """The bionic handling assistant."""
    geometry: Any = load_named("cbha").file.robots["cbha"].geometry
    return arm(
        "cbha",
        [145, 115, 115, 95, 105, 105],
        1.15,
        True,
        list(geometry.radius_mm),
        [0.0, 0.0],
        (
            "layout: paper has tubes at 180, 60, -60 degrees",
            "extra axes: wrist_mm, gripper_mm (no kinematics)",
        ),
        "seen from +z",
    )


def stiffflop() -> Drawing:
    """The hanging pneumatic arm of two sections."""
    sections: Any = load_named("stiffflop2").file.robots["arm"].geometry.sections
    return arm(
        "stiffflop2",
        [0.05, 0.25, 0.25, 0.5, 0.3, 0.3],
        2.7,
        False,
        [section.chamber_placement_mm for section in sections],
        [section.link_mm for section in sections],
        (
            "+z of the base points down, along gravity",
            f"p1 is a pair of chambers; outer radius {sections[0].radius_mm:g} mm",
        ),
        "seen from +z, which is from below",
        platform_below_mid=False,
    )


def chain() -> Drawing:
    """Two arms and a rope between their tips, in the plane of the bases."""
    robots: Any = load_named("chain").file.robots
    arms = Robot("chain")
    rope = next(link.rope for link in robots["rope"].links if link.rope is not None)
    d = Drawing("chain: two arms and a rope, x-z plane of the world", 760, 420)
    d.view((110, 250), 0.72)
    tips = {}
    for name, actuation in {"left": [120, 132, 132, 112, 118, 118], "right": [125] * 3 + [115] * 3}.items():
        along = arms[name].backbone(actuation, 201)[:, [0, 2]]
        half = len(along) * np.mean(actuation[:3]) / (np.mean(actuation[:3]) + np.mean(actuation[3:]))
        pieces = (along[: int(half)], along[int(half) :])
        for part, radius in zip(pieces, robots[name].geometry.radius_mm, strict=True):
            for side in (-radius, radius):
                d.line(offset(part, side), AXIS, 2)
        d.line(along, BODY, 1.5, "4 3")
        d.frame(
            along[0],
            [1, 0],
            [0, 1],
            ("x", "z", f"base of {name}" if name == "right" else "world, base of left"),
            62,
        )
        tips[name] = arms[name].fk(actuation).tip
        d.circle(tips[name][[0, 2]], 5, BODY, BODY)
        d.label(tips[name][[0, 2]], f"tip of {name}", BODY, (0, -12), "middle")
    hanging = hang(tips["left"] / 1e3, tips["right"] / 1e3, rope.length_mm / 1e3)
    if hanging is None:
        raise ValueError("the rope is too short for the drawn postures")
    curve = 1e3 * np.asarray(hanging.points(81))[:, [0, 2]]
    d.line(curve, BODY, 2.5)
    d.label(curve[40], f"rope.length_mm {rope.length_mm:g}, a catenary", BODY, (0, -30), "middle")
    floor = robots["rope"].floor_mm
    d.line([[-80, floor], [790, floor]], "black", 2)
    d.label([350, floor], f"floor_mm {floor:g}", SIZE, (0, 16), "middle")
    d.size(
        [0, -120],
        [robots["right"].base.x_mm, -120],
        f"base.x_mm {robots['right'].base.x_mm:g}",
        (0, -6),
        "middle",
    )
    d.note(
        (16, 405),
        "Axes as in cbha: left.s1.l1_mm to right.s2.l3_mm; extra axes left.gripper_mm, right.gripper_mm",
    )
    return d


DRAWINGS = {
    "axes-hand.svg": rack_hand,
    "axes-trirack2.svg": trirack,
    "axes-cbha.svg": cbha,
    "axes-stiffflop2.svg": stiffflop,
    "axes-chain.svg": chain,
}


if __name__ == "__main__":
    write_drawings(DRAWINGS)
