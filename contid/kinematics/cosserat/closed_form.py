"""Exact inverse kinematics of the unloaded rod: each section is a circular arc.

Without load the strains of a section are constant. Its end point determines its arc, the arc its three
pressures; two sections with a tip direction form a biarc with one free parameter.
"""

from __future__ import annotations

import math

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.section import Rod, Section


def average_pressure(section: Section, stretch: float) -> float:
    """Average pressure [bar] at which the section's reference length is ``stretch`` times its length.

    Solves ``stretch - 1 = 6 x A_c / (E(x) A)`` (eq. 18) by Newton's method inside a shrinking bracket; the
    right side grows with x up to the clamp of the modulus. Beyond, E is constant and x proportional.
    """
    push = 3.0 * section.pair_force / section.area
    strain = stretch - 1.0
    if strain <= 0.0:
        return strain * section.modulus(0.0)[0] / push
    top = section.modulus_up_to_bar
    at_top = section.modulus(top)[0]
    if strain >= push * top / at_top:
        return strain * at_top / push
    low, high, x = 0.0, top, 0.5 * top
    for _ in range(60):
        modulus, slope = section.modulus(x)
        error = push * x / modulus - strain
        if error > 0.0:
            high = x
        else:
            low = x
        newton = x - error / (push / modulus * (1.0 - x * slope / modulus))
        following = newton if low < newton < high else 0.5 * (low + high)
        if abs(following - x) < 1e-15:
            break
        x = following
    return x


def arc_pressures(section: Section, end: Array) -> Array:
    """Pressures [bar], shape (3,), that bring the unloaded section's end to ``end`` [mm] in its base frame.

    They may be negative or too large: the caller clamps. The end must not be the base itself.
    """
    r, z = math.hypot(end[0], end[1]), float(end[2])
    half = math.atan2(r, z)
    chord = math.hypot(r, z)
    arc = chord * (half / math.sin(half) if half > 1e-8 else 1.0)
    x = average_pressure(section, arc / section.length)
    curvature = np.zeros(2)
    if r > 0.0:
        curvature = 2.0 * half / section.length / r * np.array([-end[1], end[0]])
    rows = np.vstack([section.pair_moment[:2], np.ones(3)])
    modulus = section.modulus(x)[0]
    return np.linalg.solve(rows, np.array([*(modulus * section.inertia * curvature), 3.0 * x]))


def minimal_rotation(a: Array, b: Array) -> Array:
    """Rotation that takes unit vector a to b the short way, shape (3, 3); half a turn about any normal."""
    c = float(a @ b)
    if c < -1.0 + 1e-12:
        normal = np.cross(a, [1.0, 0.0, 0.0] if abs(a[0]) < 0.9 else [0.0, 1.0, 0.0])
        normal /= np.linalg.norm(normal)
        return 2.0 * np.outer(normal, normal) - np.eye(3)
    w = np.cross(a, b)
    k = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    rotation: Array = np.eye(3) + k + k @ k / (1.0 + c)
    return rotation


def _arc_and_link(link: float, end: Array) -> tuple[Array, Array]:
    """End of the arc and tangent there, for an arc followed by a straight link that ends at ``end``."""
    d = (float(end @ end) - link**2) / (2.0 * (float(end[2]) + link))
    e3 = np.array([0.0, 0.0, 1.0])
    tangent = (end - d * e3) / (d + link)
    return d * (e3 + tangent), tangent


def tip_pressures(section: Section, tip: Array) -> Array:
    """Mode (a), one section: pressures for a tip position [mm]."""
    if section.link == 0.0:
        return arc_pressures(section, tip)
    return arc_pressures(section, _arc_and_link(section.link, tip)[0])


def mid_and_tip_pressures(rod: Rod, mid: Array, tip: Array) -> Array:
    """Mode (b), two sections: pressures for the end of the first section and the tip [mm]."""
    first, second = rod.sections
    m = 2.0 * float(mid[2]) / float(mid @ mid) * mid - np.array([0.0, 0.0, 1.0])
    frame = minimal_rotation(np.array([0.0, 0.0, 1.0]), m)
    rest = frame.T @ (tip - mid - first.link * m)
    return np.concatenate([arc_pressures(first, mid), tip_pressures(second, rest)])


def tip_and_direction_pressures(rod: Rod, tip: Array, direction: Array, d1: float) -> Array:
    """Mode (c), two sections: pressures for tip and tip direction; ``d1`` [mm] is the free parameter.

    The sections and the link form a biarc with tangent lengths d1 and d2 (d1 = half a straight section's
    length, roughly): ``tip = d1 e3 + (d1 + link + d2) m + (d2 + tip link) t``.
    """
    first, second = rod.sections
    e3 = np.array([0.0, 0.0, 1.0])
    end = tip - second.link * direction
    link = first.link
    d2 = (float(end @ end) - link**2 - 2.0 * d1 * (float(end[2]) + link)) / (
        2.0 * (float(end @ direction) + link) + 2.0 * d1 * (1.0 - float(direction[2]))
    )
    m = (end - d2 * direction - d1 * e3) / (d1 + link + d2)
    return mid_and_tip_pressures(rod, d1 * (e3 + m), tip)
