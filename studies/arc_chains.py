"""Frames, Jacobians and task errors of chains of arcs over arrays, for the methods of other papers.

Robots use the kernel ``contid/kernels/arc``, which takes single rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from contid.kinematics.arc import arc
from contid.kinematics.arc.sections import ArcChain, Sections
from contid.kinematics.array import Array
from contid.targets import Vec3
from contid_fit.calibrate.tendon.arc_jacobians import jacobians

Arc: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Frames:
    """Frames of a chain in the base frame.

    Attributes:
        tip: position of the tip [m], ``(..., 3)``.
        rotation: of the tip, ``(..., 3, 3)``.
        mid: end of the first section, its rigid piece included [m], ``(..., 3)``.
    """

    tip: Array
    rotation: Array
    mid: Array


@dataclass(frozen=True, slots=True)
class Derivatives:
    """Derivatives by the tube lengths, each ``(..., 3, 3 n)``; ``spin``: spatial angular velocity [1/m]."""

    frames: Frames
    tip: Array
    spin: Array
    mid: Array


def forward(sections: ArcChain, lengths: Array | Sequence[float]) -> Frames:
    """Where the chain ends: ``p = p1 + R1 (h1 e_z + p2 + R2 (...))``."""
    arcs = sections.arcs(lengths)
    position = np.zeros((*arcs.shape[:-2], 3))
    rotation = np.broadcast_to(np.eye(3), (*arcs.shape[:-2], 3, 3))
    mid = position
    for i, rigid_m in enumerate(sections.rigid_m):
        p, r = arc.pose(arcs[..., i, 0], arcs[..., i, 1], arcs[..., i, 2])
        p = p + rigid_m * r[..., :, 2]
        position = position + (rotation @ p[..., None])[..., 0]
        rotation = rotation @ r
        if i == 0:
            mid = position
    return Frames(_with_offset(sections, position, rotation), rotation, mid)


def differentiate(sections: ArcChain, lengths: Array | Sequence[float]) -> Derivatives:
    """Jacobians of tip, orientation and mid-point: ``J_i = R (Jp_i + Jw_i x rest_i) d(u, v, L)/dl``.

    ``R`` is the frame where section i starts and ``rest_i`` leads from its end to the tip.
    """
    arcs = sections.arcs(lengths)
    batch = arcs.shape[:-2]
    position = np.zeros((*batch, 3))
    rotation = np.broadcast_to(np.eye(3), (*batch, 3, 3))
    ends, linear, spin = [], [], []
    mid = position
    for i, rigid_m in enumerate(sections.rigid_m):
        u, v, L = arcs[..., i, 0], arcs[..., i, 1], arcs[..., i, 2]
        p, r = arc.pose(u, v, L)
        jp, jw = jacobians(u, v, L)
        linear.append(rotation @ jp @ sections.to_arc[i])
        spin.append(rotation @ jw @ sections.to_arc[i])
        end = position + (rotation @ p[..., None])[..., 0]
        ends.append(end)
        rotation = rotation @ r
        position = end + rigid_m * rotation[..., :, 2]
        if i == 0:
            mid = position
    position = _with_offset(sections, position, rotation)
    tip_columns = [
        linear[i] + np.cross(spin[i], (position - ends[i])[..., None], axis=-2) for i in range(sections.count)
    ]
    mid_columns = [np.zeros_like(columns) for columns in linear]
    mid_columns[0] = linear[0] + np.cross(spin[0], (mid - ends[0])[..., None], axis=-2)
    return Derivatives(
        Frames(position, rotation, mid),
        np.concatenate(tip_columns, axis=-1),
        np.concatenate(spin, axis=-1),
        np.concatenate(mid_columns, axis=-1),
    )


def _with_offset(sections: ArcChain, position: Array, rotation: Array) -> Array:
    if not any(sections.offset_m):
        return position
    shifted: Array = position + rotation[..., :, :2] @ np.array(sections.offset_m)
    return shifted


def lengths_of(sections: Sections, arcs: Array) -> Array:
    """Tube lengths ``(..., 3 n)`` [m] of arcs (u, v, L), shape ``(..., n, 3)``."""
    stacked: Array = np.einsum("nij,...nj->...ni", sections.to_lengths, arcs)
    return stacked.reshape(*stacked.shape[:-2], 3 * sections.count)


class Goal(NamedTuple):
    """Tip, and optionally unit tangent, frame (row by row) or mid-point, in the base frame [m]."""

    tip: Vec3
    direction: Vec3 | None = None
    mid: Vec3 | None = None
    rotation: tuple[float, ...] | None = None


def turn_left(target: Array, at: Array) -> Array:
    """Rotation vector phi [rad] with ``exp(phi) at = target``, at most half a turn."""
    r = target @ at.T
    v = 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    s, c = math.sqrt(float(v @ v)), 0.5 * (float(np.trace(r)) - 1.0)
    if s > 1e-6:
        return np.asarray(math.atan2(s, c) / s * v)
    if c > 0.0:
        return v
    k = int(np.argmax(np.diag(r)))  # half a turn: R + 1 = 2 axis axis^T
    size = math.sqrt(max(0.5 * (float(r[k, k]) + 1.0), 1e-300))
    axis = 0.25 * (r[:, k] + r[k]) / size
    axis[k] = size
    return np.asarray(math.pi * axis)


def task(sections: ArcChain, ell_m: float, lengths: Array, goal: Goal) -> tuple[Array, Array]:
    """Error rows ``(m,)`` [m] and their Jacobian ``(m, 3 n)`` at ``lengths``."""
    at = differentiate(sections, lengths)
    errors, rows = [np.array(goal.tip) - at.frames.tip], [at.tip]
    if goal.direction is not None:
        tangent = at.frames.rotation[:, 2]
        errors.append(ell_m * (np.array(goal.direction) - tangent))
        rows.append(ell_m * np.cross(at.spin, tangent[:, None], axis=0))
    if goal.rotation is not None:
        errors.append(ell_m * turn_left(np.reshape(goal.rotation, (3, 3)), at.frames.rotation))
        rows.append(ell_m * at.spin)  # the gradient of |phi|^2/2 is exact: phi is an eigenvector of d exp
    if goal.mid is not None:
        errors.append(np.array(goal.mid) - at.frames.mid)
        rows.append(at.mid)
    return np.concatenate(errors), np.vstack(rows)


def arc_of_leg(tangent: Array, leg_m: float) -> Arc | None:
    """The arc (u, v, L) that starts along +z, ends along ``tangent`` and has the control leg ``leg_m``."""
    bend_xy = math.hypot(tangent[0], tangent[1])
    theta = math.atan2(bend_xy, tangent[2])
    if leg_m < 0.0:
        theta -= 2.0 * math.pi
    if bend_xy < 1e-12:
        return (0.0, 0.0, 2.0 * leg_m) if leg_m > 0.0 and tangent[2] > 0.0 else None
    length = leg_m * theta / math.tan(0.5 * theta) if abs(theta) > 1e-9 else 2.0 * leg_m
    return theta * float(tangent[0]) / bend_xy, theta * float(tangent[1]) / bend_xy, length


def biarc(tip_m: Array, tangent: Array, leg_m: float, rigid_m: tuple[float, float]) -> tuple[Arc, Arc] | None:
    """The two arcs whose tip is ``tip_m`` along ``tangent`` for one control leg of the first section.

    ``contid/kernels/arc/closed_form.hpp`` derives it.

    Args:
        tip_m: tip after the last rigid piece [m], shape (3,).
        tangent: unit tangent at the tip, shape (3,).
        leg_m: the free parameter a [m].
        rigid_m: rigid pieces after the first and after the second section [m].
    """
    between, after = rigid_m
    p = tip_m - after * tangent
    denominator = 2.0 * (float(p @ tangent) + leg_m * (1.0 - tangent[2]) + between)
    if denominator == 0.0:
        return None
    leg2_m = (float(p @ p) - 2.0 * leg_m * p[2] - between * between - 2.0 * between * leg_m) / denominator
    middle_m = leg_m + leg2_m + between
    if middle_m == 0.0:
        return None
    joint_tangent = (p - leg2_m * tangent) / middle_m
    joint_tangent[2] -= leg_m / middle_m
    first = arc_of_leg(joint_tangent, leg_m)
    if first is None:
        return None
    _, rotation = arc.pose(np.array(first[0]), np.array(first[1]), np.array(first[2]))
    second = arc_of_leg(rotation.T @ tangent, leg2_m)
    return None if second is None else (first, second)
