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
    before = np.concatenate([np.broadcast_to(along, z[:, 0].shape)[:, None], z[:, :-1]], axis=1)
    turns = _turns(before, z)
    x = np.empty_like(z)
    last = np.broadcast_to(across, z[:, 0].shape)
    for k in range(z.shape[1]):
        last = np.matmul(turns[:, k], last[:, :, None])[:, :, 0]
        x[:, k] = last
    x -= z * np.sum(x * z, axis=-1, keepdims=True)
    x /= np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), TINY)
    return x, np.cross(z, x), z


def _turns(before: Array, after: Array) -> Array:
    """The least rotations that turn unit vectors into others, each (..., 3): matrices (..., 3, 3)."""
    w = np.cross(before, after)
    c = np.sum(before * after, axis=-1)
    turns = w[..., :, None] * (w / np.maximum(1.0 + c, TINY)[..., None])[..., None, :]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        turns[..., i, i] += c
        turns[..., i, j] -= w[..., k]
        turns[..., j, i] += w[..., k]
    return np.asarray(turns)
