"""Where the elements of constant strain of a rod end."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from contid.kinematics.array import Array

#: Terms of the series in the square of an element's turn, which stays far below half a turn.
_TERMS: Final = range(12)


class PlacedElements(NamedTuple):
    """Start and ends of the elements [m], ``(elements + 1, 3)``; rotation of the last end to the base."""

    points: Array
    last_frame: Array


def place_elements(strain: Array, lengths_m: Array, rigid_m: Array, base_m: float) -> PlacedElements:
    """Chain the elements of a rod one after the other, from ``base_m`` above the origin along z.

    An element turns by ``w = (-v, u, t)`` with bend (u, v) and twist t, and its end lies at

        h (1 + e) (e_z + B w x e_z + C w x (w x e_z)),   B = (1 - cos |w|)/|w|^2,   C = (|w| - sin |w|)/|w|^3

    in the frame of its start; ``rigid_m[i]`` follows along the local z.
    """
    w = np.stack((-strain[:, 1], strain[:, 0], strain[:, 2]), axis=1)
    square = np.sum(w * w, axis=1)
    a, b, c = (_series(square, offset)[:, None] for offset in (1, 2, 3))
    across = np.cross(w, (0.0, 0.0, 1.0))
    stretched = (lengths_m * (1.0 + strain[:, 3]))[:, None]
    ends = stretched * (np.array((0.0, 0.0, 1.0)) + b * across + c * np.cross(w, across))
    skew = np.cross(np.eye(3), w[:, None, :])  # skew v = w x v
    turns = np.eye(3) + a[:, :, None] * skew + b[:, :, None] * (skew @ skew)
    ends = ends + rigid_m[:, None] * turns[:, :, 2]
    points, frame = np.empty((len(w) + 1, 3)), np.eye(3)
    points[0] = (0.0, 0.0, base_m)
    for n, (end, turn) in enumerate(zip(ends, turns, strict=True)):
        points[n + 1] = points[n] + frame @ end
        frame = frame @ turn
    return PlacedElements(points, frame)


def _series(square: Array, offset: int) -> Array:
    """``sum_n (-square)^n / (2 n + offset)!``: sin t / t, (1 - cos t)/t^2, (t - sin t)/t^3 for 1, 2, 3."""
    terms = np.stack([(-square) ** n / math.factorial(2 * n + offset) for n in _TERMS])
    return np.asarray(terms.sum(axis=0))
