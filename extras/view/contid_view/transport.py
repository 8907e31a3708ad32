"""Frames along lines by parallel transport: without twist, many lines at once."""

from __future__ import annotations

from typing import Final

import numpy as np

from contid.kinematics.array import Array

#: Lengths below this have no direction.
TINY: Final = 1e-12


def tangents(lines: Array) -> Array:
    """Unit tangents at the points of lines, (..., points, 3)."""
    along = np.gradient(lines, axis=-2)
    return np.asarray(along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), TINY))


def transported(lines: Array, across: Array, along: Array) -> tuple[Array, Array, Array]:
    """Frames along lines by parallel transport, without twist.

    The minimal rotation from one tangent to the next takes ``x`` along; ``y = z x x``.

    Args:
        lines: (n, points, 3).
        across: x axis at the beginning of every line.
        along: tangent there.

    Returns:
        Axes x, y and tangents z, each (n, points, 3).
    """
    z = tangents(lines)
    x = np.empty_like(z)
    before, last = np.broadcast_to(along, z[:, 0].shape), np.broadcast_to(across, z[:, 0].shape)
    for k in range(z.shape[1]):
        last = _turned(last, before, z[:, k])
        x[:, k], before = last, z[:, k]
    return x, np.cross(z, x), z


def _turned(vectors: Array, before: Array, after: Array) -> Array:
    """Vectors rotated as the tangents are, with the least rotation, each (n, 3)."""
    w = np.cross(before, after)
    c = np.sum(before * after, axis=1, keepdims=True)
    dot = np.sum(w * vectors, axis=1, keepdims=True)
    turned = vectors * c + np.cross(w, vectors) + w * dot / np.maximum(1.0 + c, TINY)
    turned -= after * np.sum(turned * after, axis=1, keepdims=True)
    return np.asarray(turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), TINY))
