"""The body of a continuum robot: a curve sampled at equal arc length, swept by a ball.

Between two samples that are an arc length h apart, a curve stays inside the ellipsoid of revolution with
these samples as foci and h as its long axis. With the chord c it is therefore at most

    sqrt(h^2 - c^2) / 2

off the chord, whatever its curvature; for an arc this is 1.155 times its sagitta. So a chain of arcs, a rod
in equilibrium and a Pythagorean-hodograph curve are bounded by the same arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from contid.kinematics.array import Array, polyline_length

#: Samples are added, up to `MAX_PIECES` pieces, until the distance bound above is below this for each [m].
ALLOWANCE_M: Final = 2.5e-5
MIN_PIECES: Final = 32
MAX_PIECES: Final = 1024
#: Added to an arc length between samples, relative: the error of the measured length where curvature jumps.
_LENGTH_ROUNDING: Final = 4e-6


@dataclass(frozen=True, eq=False, slots=True)
class Body:
    """A swept curve.

    Attributes:
        points: points of the curve at equal arc length, shape ``(n + 1, 3)`` [m].
        spacing_m: upper bound of the arc length between neighbours [m].
        radius_m: radius of the ball [m].
        start_m: arc length of the first point from the base of the robot [m].
        off_m: greatest distance of the curve from the polyline that the points were taken from [m]; 0 for
            points of the curve itself.
        piece_off_m: greatest distance of the curve between neighbours from their chord, where known [m].
    """

    points: Array
    spacing_m: float
    radius_m: float
    start_m: float = 0.0
    off_m: float = 0.0
    piece_off_m: float | None = None

    @property
    def pieces(self) -> int:
        """Number of intervals between points."""
        return len(self.points) - 1

    def part(self, from_m: float, to_m: float) -> Body:
        """The part between two arc lengths from the base [m].

        Its ends are interpolated between samples, so they move continuously with the arc lengths. Its points
        are on the polyline of this body, from which the curve is at most the allowance of a piece away.
        """
        begin, end = ((each - self.start_m) / self.spacing_m for each in (from_m, to_m))
        begin = min(max(begin, 0.0), float(self.pieces))
        end = min(max(end, begin), float(self.pieces))
        if begin == 0.0 and end == self.pieces:
            return self
        pieces = max(math.ceil(end - begin), 1)
        at = begin + (end - begin) / pieces * np.arange(pieces + 1)
        before = np.minimum(at.astype(int), self.pieces - 1)
        share = (at - before)[:, None]
        points = (1.0 - share) * self.points[before] + share * self.points[before + 1]
        off_m = self.off_m + self.off_pieces_m()
        spacing_m = (end - begin) / pieces * self.spacing_m
        return Body(points, spacing_m, self.radius_m, self.start_m + begin * self.spacing_m, off_m)

    def divided(self, spacing_m: float) -> Body:
        """The same body with points at most a distance apart along it [m]; they are on its polyline."""
        times = max(math.ceil(self.spacing_m / spacing_m), 1)
        if times == 1:
            return self
        share = np.arange(times)[None, :, None] / times
        between = (1.0 - share) * self.points[:-1, None] + share * self.points[1:, None]
        points = np.vstack([between.reshape(-1, 3), self.points[-1:]])
        off_m = self.off_m + self.off_pieces_m()
        return Body(points, self.spacing_m / times, self.radius_m, self.start_m, off_m)

    def off_pieces_m(self) -> float:
        """Greatest distance of the curve from the chords between neighbours [m].

        A piece of an arc length ``s`` whose ends are ``c`` apart lies in an ellipse of the half axis
        ``sqrt(s**2 - c**2) / 2``.
        """
        if self.piece_off_m is not None:
            return self.piece_off_m
        chords = self.points[1:] - self.points[:-1]
        shortest = float(np.einsum("ij,ij->i", chords, chords).min())
        return 0.5 * math.sqrt(max(self.spacing_m * self.spacing_m - shortest, 0.0))


def sampled_body(curve: Callable[[int], Array], radius_m: float) -> Body:
    """A body from a function that gives any number of points at equal arc length.

    Args:
        curve: number of points to points, shape ``(points, 3)`` [m].
        radius_m: radius of the body [m].
    """
    pieces = MIN_PIECES
    while True:
        points = np.asarray(curve(pieces + 1), dtype=float)
        # Chords are short by the square of their size: two polylines give the length (Richardson).
        fine, coarse = polyline_length(points), polyline_length(points[::2])
        length = max(fine, (4.0 * fine - coarse) / 3.0)
        body = Body(points, length / pieces * (1.0 + _LENGTH_ROUNDING), radius_m)
        off_m = body.off_pieces_m()
        if pieces >= MAX_PIECES or off_m <= ALLOWANCE_M:
            return replace(body, piece_off_m=off_m)
        pieces *= 2
