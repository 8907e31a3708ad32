"""Heuristics that reach forward and backward, in NumPy: FABRIKc and CRRIK.

A segment of length L that bends by theta is two virtual links of ``L tan(theta/2) / theta``, tangent to its
ends, that meet in a virtual joint. An iteration goes from the goal to the base and back; after the way back
the arm is whole, and its bends are given. The state is the row of virtual joints.

* FABRIKc (Zhang, Yang, Dong, Xu; ICRA 2018): on the way to the base the links turn to the virtual joint of
  the segment before, and their length follows from the new bend.
* CRRIK (J. Intell. Robot. Syst. 2022): the way to the base is a rope that is pulled at one end: virtual
  joints follow one another at the distances of the last iteration, without a new bend. The text read here
  is the abstract; the way back is that of FABRIKc.

Limits: a virtual link grows without bound as a bend approaches half a turn, so bends are held below
`LARGEST_RAD`. They meet a tip and its tangent, no frame, mid-point or load; limits other than a largest
bend are not part of them. Convergence is linear and is not certain, also for poses within reach. Where no
tangent is asked for, the last segment turns to the goal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from studies.arc_chains import Goal
from studies.segment_arms import SegmentArm

LARGEST_RAD: Final = math.radians(175.0)
_Z: Final = np.array((0.0, 0.0, 1.0))


def fabrikc(arm: SegmentArm, goal: Goal) -> Iterator[Array]:
    """FABRIKc; bend vectors ``(segments, 2)`` [rad] after every iteration."""
    return _reached(arm, goal, _links_to_base)


def crrik(arm: SegmentArm, goal: Goal) -> Iterator[Array]:
    """CRRIK as its abstract describes it."""
    return _reached(arm, goal, _rope_to_base)


def _reached(
    arm: SegmentArm, goal: Goal, to_base: Callable[[SegmentArm, Goal, Array, Array], Array]
) -> Iterator[Array]:
    links = np.full(arm.count, 0.5 * arm.length_m)
    # The straight arm, a little off its line: there every pull along the line is in balance.
    joints = (np.arange(arm.count) + 0.5)[:, None] * arm.length_m * _Z
    joints[:, 0] += 1e-3 * arm.length_m * (np.arange(arm.count) % 2)
    while True:
        joints = to_base(arm, goal, joints, links)
        joints, links, tangents = _from_base(arm, goal, joints)
        yield _bends(tangents)


def _links_to_base(arm: SegmentArm, goal: Goal, joints: Array, links: Array) -> Array:
    """Virtual joints from the goal to the base, links as long as the bends ask."""
    found = np.empty_like(joints)
    end = np.array(goal.tip)
    tangent = _unit(end - joints[-1]) if goal.direction is None else np.array(goal.direction)
    for i in range(arm.count - 1, -1, -1):
        before = joints[i - 1] if i else np.zeros(3)
        joint = end - links[i] * tangent
        first = _unit(joint - before)
        link = _link_m(arm.length_m, _angle(first, tangent))
        found[i] = end - link * tangent
        tangent = _unit(found[i] - before)
        end = found[i] - link * tangent
    return found


def _rope_to_base(arm: SegmentArm, goal: Goal, joints: Array, links: Array) -> Array:
    """Virtual joints that follow the goal like a rope, distances as they were."""
    found = np.empty_like(joints)
    end = np.array(goal.tip)
    tangent = _unit(end - joints[-1]) if goal.direction is None else np.array(goal.direction)
    found[-1] = end - links[-1] * tangent
    for i in range(arm.count - 2, -1, -1):
        found[i] = found[i + 1] - (links[i] + links[i + 1]) * _unit(found[i + 1] - joints[i])
    return found


def _from_base(arm: SegmentArm, goal: Goal, joints: Array) -> tuple[Array, Array, list[Array]]:
    """A whole arm from the base along the virtual joints: joints, links [m] and tangents of all ends."""
    found, links = np.empty_like(joints), np.empty(arm.count)
    start, tangents = np.zeros(3), [_Z]
    for i in range(arm.count):
        last = i == arm.count - 1
        ahead = np.array(goal.tip) if last else joints[i + 1]
        link = float(np.linalg.norm(joints[i] - start)) or 0.5 * arm.length_m
        link = min(link, _link_m(arm.length_m, LARGEST_RAD))
        for _ in range(3):  # the link follows from the bend, which follows from the place of the joint
            joint = start + link * tangents[-1]
            tangent = _unit(ahead - joint)
            if last and goal.direction is not None:
                tangent = np.array(goal.direction)
            tangent = _held(tangents[-1], tangent)
            link = _link_m(arm.length_m, _angle(tangents[-1], tangent))
        found[i], links[i] = start + link * tangents[-1], link
        start = found[i] + link * tangent
        tangents.append(tangent)
    return found, links, tangents


def _bends(tangents: list[Array]) -> Array:
    """Bend vectors of torsion-free segments between tangents."""
    frame, bends = np.eye(3), []
    for after in tangents[1:]:
        x, y, z = (frame.T @ after).tolist()
        across = math.hypot(x, y)
        theta = math.atan2(across, z)
        u, v = (theta * x / across, theta * y / across) if across > 0.0 else (0.0, 0.0)
        bends.append((u, v))
        frame = frame @ _least_turn(x, y, z)
    return np.array(bends)


def _least_turn(x: float, y: float, z: float) -> Array:
    """The rotation about an axis across z that turns z to this unit vector; z is above -1."""
    k = 1.0 / (1.0 + z)
    return np.array(((1.0 - k * x * x, -k * x * y, x), (-k * x * y, 1.0 - k * y * y, y), (-x, -y, z)))


def _held(before: Array, after: Array) -> Array:
    """The tangent after a segment with the largest bend, where it would bend more."""
    if _angle(before, after) <= LARGEST_RAD:
        return after
    across = after - float(after @ before) * before
    size = float(np.linalg.norm(across))
    side = across / size if size > 1e-12 else np.cross(before, _Z if abs(before[2]) < 0.9 else np.eye(3)[0])
    return np.asarray(math.cos(LARGEST_RAD) * before + math.sin(LARGEST_RAD) * _unit(side))


def _link_m(length_m: float, theta: float) -> float:
    theta = min(theta, LARGEST_RAD)
    return 0.5 * length_m if theta < 1e-9 else length_m * math.tan(0.5 * theta) / theta


def _angle(a: Array, b: Array) -> float:
    return 2.0 * math.atan2(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b)))


def _unit(vector: Array) -> Array:
    size = float(np.linalg.norm(vector))
    return vector / size if size > 1e-300 else _Z
