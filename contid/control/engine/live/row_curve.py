"""The curve of one robot through the rows of a live stream: a uniform cubic B-spline.

At the phase ``i + u`` the curve is the mean of the rows i-1 .. i+2 with the weights of the spline. It is
continuous to the acceleration, stays between the rows, and ends at rest on a row that is repeated. It leaves
rows by a sixth of their second difference: on a circle by ``T^2 a / 6``.

A row that is missing when the curve gets to it is the one expected after the last two: beyond the last row
the curve is a straight line. A row that was used stays as it was.

Source: C. de Boor, "A Practical Guide to Splines", Springer 2001, chapter IX.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, TypeAlias

#: Coordinates of a target (`contid.control.engine.live.target_vector`).
Vector: TypeAlias = tuple[float, ...]

#: Rows kept behind the phase, which may come back to the last row.
_KEPT: Final = 100


class RowCurve:
    """Rows by number, and the curve through them.

    Attributes:
        newest: number of the newest row.
    """

    def __init__(self, number: int, row: Vector) -> None:
        self.newest = number
        self._rows: dict[int, Vector] = {number: row}
        self._first = number
        self._oldest = row
        self._last, self._before = row, row

    @property
    def last(self) -> Vector:
        """The newest row."""
        return self._last

    @property
    def before(self) -> Vector:
        """The row before the newest."""
        return self._before

    def add(self, number: int, row: Vector) -> None:
        """A new row; those between it and the newest are filled in on the straight line."""
        gap = number - self.newest
        for k in range(1, gap):
            share = k / gap
            between = tuple([a + share * (b - a) for a, b in zip(self._last, row, strict=True)])
            self._rows.setdefault(self.newest + k, between)
            self._before = between
        if gap == 1:
            self._before = self._last
        self._rows.setdefault(number, row)
        self.newest, self._last = number, row

    def at(self, phase: float) -> Vector:
        """The curve at a phase; rows that it is made of are used."""
        i = math.floor(phase)
        a, b, c, d = (self._row(i + k) for k in (-1, 0, 1, 2))
        self._forget(i - 1 - _KEPT)
        if a == b == c == d:
            return d
        return blended(phase - i, (a, b, c, d))

    def rests(self, phase: float) -> bool:
        """True where the curve stands on the newest row."""
        i, last, row = math.floor(phase), self._last, self._row
        return row(i - 1) == last and row(i) == last and row(i + 1) == last and row(i + 2) == last

    def _row(self, number: int) -> Vector:
        row = self._rows.get(number)
        if row is not None:
            return row
        if number < self._first:
            return self._oldest
        on = number - self.newest
        row = tuple([b + on * (b - a) for a, b in zip(self._before, self._last, strict=True)])
        self._rows[number] = row
        return row

    def _forget(self, before: int) -> None:
        """Rows that the curve has left behind."""
        while self._first < before:
            row = self._rows.pop(self._first, None)
            if row is not None:
                self._oldest = row
            self._first += 1


def blended(u: float, rows: Sequence[Vector]) -> Vector:
    """The spline at a share ``u`` of the way between the two middle ones of four rows."""
    v, uu, uuu = 1.0 - u, u * u, u * u * u
    w0, w1 = v * v * v / 6.0, (4.0 - 6.0 * uu + 3.0 * uuu) / 6.0
    w2, w3 = (1.0 + 3.0 * u + 3.0 * uu - 3.0 * uuu) / 6.0, uuu / 6.0
    return tuple([w0 * a + w1 * b + w2 * c + w3 * d for a, b, c, d in zip(*rows, strict=True)])
