"""Closed forms for two sections: the biarc through a tip and its tangent, and two arcs through two points.

The tip pose of a torsion-free two-section arm has five degrees of freedom, its lengths have six. The free
parameter is the control leg of the first section, ``a = (L1/theta1) tan(theta1/2)``. With the tip p, its unit
tangent t, and a rigid piece h between the sections:

    b  = (p.p - 2 a p_z - h^2 - 2 h a) / (2 (p.t + a (1 - t_z) + h))      control leg of section 2
    tm = (p - b t - a e_z) / (a + b + h)                                  tangent at the joint
    theta1 = angle(e_z, tm), L1 = a theta1/tan(theta1/2), the same for section 2 in the frame of the joint

Negative legs are sections bent by more than half a turn. The rigid piece h and negative legs extend the
reference's form (h = 0, a > 0, b > 0).
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from contid.kinematics.arc import arc
from contid.kinematics.array import Array

Arc: TypeAlias = tuple[float, float, float]


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


def two_arcs(mid_m: Array, tip_m: Array, rigid_m: tuple[float, float]) -> tuple[Arc, Arc] | None:
    """The two arcs that end, each after its rigid piece, at ``mid_m`` and ``tip_m`` [m]; None if none do."""
    first = arc.through(float(mid_m[0]), float(mid_m[1]), float(mid_m[2]), rigid_m[0])
    if first is None:
        return None
    _, rotation = arc.pose(np.array(first[0]), np.array(first[1]), np.array(first[2]))
    x, y, z = rotation.T @ (tip_m - mid_m)
    second = arc.through(float(x), float(y), float(z), rigid_m[1])
    return None if second is None else (first, second)
