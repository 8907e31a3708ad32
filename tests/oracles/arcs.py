"""Constant-curvature sections by the textbook: a planar arc in the plane of its azimuth, turned by scipy."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from contid.kinematics.arc.feasible import Feasible


def bends(feasible: Feasible, lengths: np.ndarray) -> list[tuple[float, float, float]]:
    """Turning angle [rad], azimuth [rad] and length [m] of every section from the lengths of its tubes.

    ``l_j = L - d theta cos(phi - alpha_j)`` at the azimuths ``alpha_j``, solved by least squares.
    """
    sections = feasible.sections
    found = []
    for s in range(sections.count):
        d, angles = sections.radius_m[s], np.array(sections.angles_rad[s])
        rows = np.stack((-d * np.cos(angles), -d * np.sin(angles), np.ones(3)), axis=1)
        u, v, length = np.linalg.lstsq(rows, lengths[3 * s : 3 * s + 3], rcond=None)[0]
        found.append((math.hypot(u, v), math.atan2(v, u), float(length)))
    return found


def lengths_of(feasible: Feasible, arcs: list[tuple[float, float, float]]) -> np.ndarray:
    """Lengths of the tubes [m] of arcs given as turning angle, azimuth and length."""
    sections = feasible.sections
    return np.concatenate(
        [
            length - sections.radius_m[s] * theta * np.cos(phi - np.array(sections.angles_rad[s]))
            for s, (theta, phi, length) in enumerate(arcs)
        ]
    )


def tip_and_tangent(feasible: Feasible, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tip [m] and unit tangent of a chain of sections."""
    tip, turned = np.zeros(3), Rotation.identity()
    for s, (theta, phi, length) in enumerate(bends(feasible, lengths)):
        if theta < 1e-6:
            local = np.array([length * theta / 2.0, 0.0, length])
        else:
            radius = length / theta
            local = np.array([radius * (1.0 - math.cos(theta)), 0.0, radius * math.sin(theta)])
        plane = Rotation.from_euler("z", phi)
        bend = plane * Rotation.from_euler("y", theta) * plane.inv()
        tip = tip + turned.apply(plane.apply(local))
        turned = turned * bend
        tip = tip + feasible.sections.rigid_m[s] * turned.apply([0.0, 0.0, 1.0])
    return tip, turned.apply([0.0, 0.0, 1.0])


def random_posture(feasible: Feasible, rng: np.random.Generator, most_rad: float) -> np.ndarray:
    """Lengths inside every limit with each section's bend up to ``most_rad`` and any length of its range."""
    while True:
        arcs = [
            (rng.uniform(0.0, most_rad), rng.uniform(-math.pi, math.pi), rng.uniform(low, high))
            for low, high in zip(feasible.lower, feasible.upper, strict=True)
        ]
        lengths = lengths_of(feasible, arcs)
        if np.max(feasible.excess(lengths)) < 0.0:
            return lengths
