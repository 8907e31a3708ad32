"""Quintics one after another: several links, or one body too complex for a single curve.

Three kinds of joint, as Singh et al. (IROS 2018) need them:

* C1 (Eqs. 15-18): both pieces have the same derivative *vector* at the joint, its size included. Stating the
  size at every joint leaves the lengths of the pieces free.
* G1: the same direction, each piece of its own prescribed length; the sizes then differ.
* C0 (Eqs. 19-22): the same position only, as where a rope hangs from a gripper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from contid.kinematics.ph.ends import hermite
from contid.kinematics.ph.lift import Array
from contid.kinematics.ph.quintic import PhQuintic

#: Joints are compared to this share of the whole length.
TOLERANCE: Final = 1e-9


@dataclass(frozen=True, eq=False)
class PhSpline:
    """Pieces in order, each beginning where the one before ends: from `c1`, or one by one from `through`."""

    pieces: tuple[PhQuintic, ...]

    @cached_property
    def length_m(self) -> float:
        """Arc length of all pieces [m]."""
        return sum(piece.length_m for piece in self.pieces)

    @property
    def joints(self) -> tuple[str, ...]:
        """What each joint is: ``C1``, ``G1``, ``C0``, or ``open`` where the pieces do not meet."""
        return tuple(_kind(a, b, TOLERANCE * self.length_m) for a, b in pairwise(self.pieces))

    def point_at(self, s_m: Array) -> Array:
        """Points [m] at arc lengths from the start of the first piece, shape ``(n, 3)``.

        An arc length before the start or beyond the end gives that end.
        """
        s = np.asarray(s_m, dtype=np.float64).reshape(-1)
        starts = np.concatenate([[0.0], np.cumsum([piece.length_m for piece in self.pieces])[:-1]])
        owner = np.clip(np.searchsorted(starts, s, side="right") - 1, 0, len(self.pieces) - 1)
        points = np.empty((len(s), 3))
        for index, piece in enumerate(self.pieces):
            mine = owner == index
            points[mine] = piece.point(piece.parameter_at(s[mine] - starts[index]))
        return points

    def evenly(self, points: int) -> Array:
        """Points at equal arc length from the first piece to the last [m], shape ``(points, 3)``."""
        return self.point_at(np.linspace(0.0, self.length_m, points))


def c1(points_m: Sequence[Array], derivatives_m: Sequence[Array]) -> PhSpline:
    """Pieces through the points with a common derivative vector at every joint (Eqs. 15-18).

    Args:
        points_m: at least two points [m], each of shape ``(3,)``.
        derivatives_m: the derivative at each point [m], size included; neighbouring pieces share it.
    """
    ends = list(zip(points_m, derivatives_m, strict=True))
    return PhSpline(tuple(hermite(p0, p1, d0, d1) for (p0, d0), (p1, d1) in pairwise(ends)))


def _kind(before: PhQuintic, after: PhQuintic, near_m: float) -> str:
    first, last = np.zeros(1), np.ones(1)
    if np.linalg.norm(before.point(last) - after.point(first)) > near_m:
        return "open"
    along, on = before.tangent(last)[0], after.tangent(first)[0]
    if np.linalg.norm(along - on) > TOLERANCE:
        return "C0"
    return "C1" if abs(float(before.speed(last)[0] - after.speed(first)[0])) <= near_m else "G1"
