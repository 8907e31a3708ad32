"""Arcs behind each other, without gravity."""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array


def chained(bends: Array, lengths: Array, links: Array) -> Array:
    """Ends ``(n, 3)`` of arcs behind each other, with a straight link behind each.

    Args:
        bends: angle of each arc times the unit vector to which it bends, ``(n, arcs, 2)``.
        lengths: ``(n, arcs)``.
        links: ``(arcs,)``.
    """
    ends = np.zeros((len(bends), 3))
    for k in reversed(range(bends.shape[1])):
        ends[:, 2] += links[k]
        angle = np.linalg.norm(bends[:, k], axis=1)
        side = bends[:, k] / np.maximum(angle, 1e-12)[:, None]
        across = np.einsum("ij,ij->i", side, ends[:, :2])
        cos, sin = np.cos(angle), np.sin(angle)
        half = lengths[:, k] * np.sinc(0.5 * angle / np.pi)
        # What lies in the plane of the bend turns, what lies across it stays.
        turned = cos * across + sin * ends[:, 2] + half * np.sin(0.5 * angle)
        z = cos * ends[:, 2] - sin * across + half * np.cos(0.5 * angle)
        ends = np.column_stack([ends[:, :2] + (turned - across)[:, None] * side, z])
    return ends
