"""Tube lengths along a Pythagorean-hodograph curve, by offsets in a rotation-minimising frame.

A tube runs at the distance d from the backbone, in the direction ``e = U cos alpha + V sin alpha`` of a frame
(U, V) that does not spin about the tangent. Its length per length of the backbone is ``1 - d kappa . e``
exactly, with the curvature vector kappa. So between two points of the curve, S apart along the backbone,

    ``l_i = S - d (u cos alpha_i + v sin alpha_i)``,  ``u = int kappa . U ds``,  ``v = int kappa . V ds``

as for a constant-curvature section (L, u, v). For a plane curve u and v are turning angles: the lengths
depend on S and the end directions only.

The rotation-minimising frame is the Euler-Rodrigues frame turned by psi with ``psi' = -w1``; psi at the three
Gauss points of a panel comes from collocation, 8 panels per section agree with 64 in the 8th decimal of a mm.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.ph.quintic import PhQuintic

#: Panels of the integration per section.
PANELS: Final = 8

_R15: Final = math.sqrt(15.0)
#: Nodes, weights and the collocation matrix of the 3-point Gauss rule on [0, 1]: row i integrates 0..c_i.
GAUSS3_NODES: Array = np.array([0.5 - _R15 / 10.0, 0.5, 0.5 + _R15 / 10.0])
GAUSS3_WEIGHTS: Array = np.array([5.0, 8.0, 5.0]) / 18.0
GAUSS3_MATRIX: Array = np.array([
    [5.0 / 36.0, 2.0 / 9.0 - _R15 / 15.0, 5.0 / 36.0 - _R15 / 30.0],
    [5.0 / 36.0 + _R15 / 24.0, 2.0 / 9.0, 5.0 / 36.0 - _R15 / 24.0],
    [5.0 / 36.0 + _R15 / 30.0, 2.0 / 9.0 + _R15 / 15.0, 5.0 / 36.0],
])  # fmt: skip


def start_turn(curve: PhQuintic) -> float:
    """psi(0) [rad]: the turn from f2 to the base's x axis, projected across the start tangent."""
    _, f2, f3 = curve.euler_rodrigues_frame(np.zeros(1))
    return math.atan2(float(f3[0, 0]), float(f2[0, 0]))


def section_bending(curve: PhQuintic, joints_t: Array) -> Array:
    """Bending (u, v) of each section in the rotation-minimising frame that starts with U = x of the base.

    Args:
        curve: the backbone; it starts perpendicular to x.
        joints_t: parameters of the section ends in order, shape ``(n + 1,)``; the first one 0.

    Returns:
        Shape ``(n, 2)`` [rad].
    """
    sections = len(joints_t) - 1
    edges = np.concatenate([
        np.linspace(joints_t[i], joints_t[i + 1], PANELS + 1)[:-1] for i in range(sections)
    ] + [joints_t[-1:]])  # fmt: skip
    width = np.diff(edges)
    nodes = edges[:-1, None] + width[:, None] * GAUSS3_NODES
    spin, k2, k3 = (rate.reshape(nodes.shape) for rate in curve.rates(nodes))
    spun = np.concatenate([[0.0], np.cumsum(width * (spin @ GAUSS3_WEIGHTS))])[:-1]
    psi = start_turn(curve) - spun[:, None] - width[:, None] * (spin @ GAUSS3_MATRIX.T)
    cosine, sine = np.cos(psi), np.sin(psi)
    u = width * ((cosine * k2 + sine * k3) @ GAUSS3_WEIGHTS)
    v = width * ((-sine * k2 + cosine * k3) @ GAUSS3_WEIGHTS)
    bending: Array = np.stack([u, v], axis=-1).reshape(sections, PANELS, 2).sum(axis=1)
    return bending


def tube_lengths(section_m: Array, bending: Array, distance_m: Array, angles_rad: Array) -> Array:
    """Lengths of the tubes [m], shape ``(sections, tubes)``.

    Args:
        section_m: backbone length of each section, shape ``(n,)``.
        bending: (u, v) of each section, shape ``(n, 2)``.
        distance_m: distance of the tubes from the backbone in each section, shape ``(n,)``.
        angles_rad: directions of the tubes in each section, shape ``(n, tubes)``.
    """
    u, v = bending[:, :1], bending[:, 1:]
    return section_m[:, None] - distance_m[:, None] * (u * np.cos(angles_rad) + v * np.sin(angles_rad))
