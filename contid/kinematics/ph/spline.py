"""Several Pythagorean-hodograph quintics as one curve: two links, or a body too complex for a single one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.ph.quintic import PhQuintic


def points_at(pieces: Sequence[PhQuintic], s_m: Array) -> Array:
    """Points [m] at arc lengths from the start of the first piece, shape ``(n, 3)``.

    Each piece starts at the end of the one before. An arc length before the start or beyond the end gives
    that end.
    """
    starts = np.concatenate([[0.0], np.cumsum([piece.length_m for piece in pieces])[:-1]])
    piece_of = np.clip(np.searchsorted(starts, s_m, side="right") - 1, 0, len(pieces) - 1)
    points = np.empty((len(s_m), 3))
    for index, piece in enumerate(pieces):
        inside = piece_of == index
        points[inside] = piece.point(piece.parameter_at(s_m[inside] - starts[index]))
    return points
