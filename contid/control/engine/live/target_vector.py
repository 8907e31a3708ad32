"""The coordinates of a target as one vector, and back: what a curve through rows is made of.

Directions and frames are the mean of those of rows, made unit vectors again. Measured tips belong to a row,
not to the curve; they are left out.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from contid.control.engine.live.row_curve import Vector
from contid.targets import Target, frame_of_axes, unit_vector, vec3

#: Which quantities a target states; only targets of one kind have a curve.
Kind: TypeAlias = tuple[object, ...]


def kind_of(target: Target) -> Kind:
    """The kind of a target."""
    return (
        target.tip_m is not None,
        target.direction is not None,
        target.rotation is not None,
        target.mid_m is not None,
        0 if target.actuation is None else len(target.actuation),
        target.arcs is not None,
        tuple(target.extra),
    )


def vector_of(target: Target) -> Vector:
    """The coordinates of a target: tip, direction, frame, mid-point, axes, bends, load, extra axes."""
    return (
        *(target.tip_m or ()),
        *(target.direction or ()),
        *(target.rotation or ()),
        *(target.mid_m or ()),
        *(target.actuation or ()),
        *(target.arcs or ()),
        *target.load_n,
        *target.extra.values(),
    )


def target_of(vector: Vector, like: Target) -> Target:
    """The target with these coordinates, of the kind of another one."""
    at = 0
    tip_m = direction = rotation = mid_m = actuation = arcs = None
    if like.tip_m is not None:
        tip_m, at = (vector[0], vector[1], vector[2]), 3
    if like.direction is not None:
        direction, at = unit_vector(vec3(vector[at : at + 3])) or like.direction, at + 3
    if like.rotation is not None:
        rotation, at = _frame(vector[at : at + 9]) or like.rotation, at + 9
    if like.mid_m is not None:
        mid_m, at = vec3(vector[at : at + 3]), at + 3
    if like.actuation is not None:
        actuation, at = vector[at : at + len(like.actuation)], at + len(like.actuation)
    if like.arcs is not None:
        arcs, at = vector[at : at + len(like.arcs)], at + len(like.arcs)
    load_n = (vector[at], vector[at + 1], vector[at + 2])
    extra = dict(zip(like.extra, vector[at + 3 :], strict=True)) if like.extra else like.extra
    return Target(tip_m, direction, mid_m, actuation, load_n, extra, rotation=rotation, arcs=arcs)


def is_number(vector: Vector) -> bool:
    """True for coordinates that are all finite."""
    return all(map(math.isfinite, vector))


def _frame(rows: Vector) -> tuple[float, ...] | None:
    """The frame next to nine numbers: its z axis is that of them, its x axis across it."""
    return frame_of_axes((rows[2], rows[5], rows[8]), (rows[0], rows[3], rows[6]))
