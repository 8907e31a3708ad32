"""Spline of Pythagorean-hodograph quintics: several links, or a body too complex for a single curve."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.ph.quintic import PhQuintic


@dataclass(frozen=True, eq=False)
class PhSpline:
    """Pieces in order, each starting at the end of the previous one."""

    pieces: tuple[PhQuintic, ...]

    @cached_property
    def length_m(self) -> float:
        """Arc length of all pieces [m]."""
        return sum(piece.length_m for piece in self.pieces)

    def point_at(self, s_m: Array) -> Array:
        """Points [m] at arc lengths from the start of the first piece, shape ``(n, 3)``.

        An arc length before the start or beyond the end gives that end.
        """
        s = np.asarray(s_m, dtype=np.float64).reshape(-1)
        starts = np.concatenate([[0.0], np.cumsum([piece.length_m for piece in self.pieces])[:-1]])
        piece_of = np.clip(np.searchsorted(starts, s, side="right") - 1, 0, len(self.pieces) - 1)
        points = np.empty((len(s), 3))
        for index, piece in enumerate(self.pieces):
            inside = piece_of == index
            points[inside] = piece.point(piece.parameter_at(s[inside] - starts[index]))
        return points

    def evenly(self, points: int) -> Array:
        """Points at equal arc length from the first piece to the last [m], shape ``(points, 3)``."""
        return self.point_at(np.linspace(0.0, self.length_m, points))
