"""The curve of one robot through the rows of a live stream: a uniform cubic B-spline.

At the phase ``i + u`` the curve is the mean of the rows i-1 .. i+2 with the weights of the spline. It is
continuous to the acceleration, stays between the rows, and ends at rest on a row that is repeated. It leaves
rows by a sixth of their second difference: on a circle by ``T^2 a / 6``.

A row that is missing when the curve gets to it is the one expected after those that came: with their last
difference, and the second difference on which the last three and those of `BEND_S` agree. A row that was used
stays as it was; where another came in its place, the curve goes to the rows within `RETURN_S` by a quintic
polynomial of their distance, which only shrinks. Where several were expected in turn, what each added to the
distance has a way of its own.

By motion rules before 4 the curve beyond the last row is a straight line, and returns at once, by a bend that
exceeds the jerk of an easy path after 10 ms without a row. By rules 4 and 5 every row that comes after an
expected one begins the way anew with the whole distance, which adds up to 62 times what each is off.

Sources: C. de Boor, "A Practical Guide to Splines", Springer 2001, chapter IX; L. Biagiotti and C.
Melchiorri, "Trajectory Planning for Automatic Machines and Robots", Springer 2008, section 2.1.5 (quintics).
"""

from __future__ import annotations

import math
from typing import Any, Final, TypeAlias

from contid.control.tick.config import MOTION_RULES
from contid.kernels import load

#: Coordinates of a target (`contid.control.engine.live.target_vector`).
Vector: TypeAlias = tuple[float, ...]

#: Rows kept behind the phase, which may come back to the last row.
_KEPT: Final = 100
#: How long the curve takes from expected rows to those that came [s]; this many rows at least.
RETURN_S: Final = 0.15
_LEAST_RETURN: Final = 4.0
#: Ways at once; the whole distance has a new one after that.
_MOST_RETURNS: Final = 16
#: Half of the time whose rows give the second difference of a path [s]; this many rows at least.
BEND_S: Final = 0.05
_LEAST_BEND: Final = 2
#: Rows after the newest, and by motion rules from 10 on the time [s], beyond which the curve stands: where
#: the clock runs away, it does not.
_FARTHEST: Final = 25
_FARTHEST_S: Final = 0.15
#: What a bend may add, as a share of the way straight on.
_MOST_BEND: Final = 0.25


class RowCurve(dict[int, Vector]):
    """Rows by number, with those that it needs before they come, and the curve through them.

    Attributes:
        newest: number of the newest row.
        last: the newest row.
        before: the row before the newest.
    """

    def __init__(self, number: int, row: Vector, rules: int = MOTION_RULES) -> None:
        super().__init__({number: row})
        self.newest = number
        self.last, self.before = row, row
        self._rules = rules
        self._period_s = 0.0
        kernel = load("limiter")
        self._ways: Any = kernel.RowWays(row, _MOST_RETURNS)
        self._between: Any = kernel.between_rows
        self._came: dict[int, Vector] = {number: row}
        self._first = number
        self._oldest = row

    def add(self, number: int, row: Vector, period_s: float) -> None:
        """A new row; those between it and the newest are filled in on the straight line.

        Args:
            number: of the row.
            row: its coordinates.
            period_s: between rows; 0 while it is not known.
        """
        gap, self._period_s = number - self.newest, period_s or self._period_s
        for k in range(1, gap):
            share = k / gap
            between = tuple([a + share * (b - a) for a, b in zip(self.last, row, strict=True)])
            self._take(self.newest + k, between)
            self.before = between
        if gap == 1:
            self.before = self.last
        self._take(number, row)
        self.newest, self.last = number, row

    def _take(self, number: int, row: Vector) -> None:
        """A row comes; the one that was used in its place stays, and is left behind smoothly."""
        self._came[number] = row
        used = self.get(number)
        self._ways.forget(number)
        if used is None:
            self[number] = self._ways.moved(row, number)
        elif self._rules > 3:
            if self._rules < 6 or self._ways.full:
                self._ways.clear()
            length = RETURN_S / self._period_s if self._period_s else 0.0
            self._ways.came(number, row, used, max(_LEAST_RETURN, length))

    def at(self, phase: float) -> Vector:
        """The curve at a phase; rows that it is made of are used."""
        i = math.floor(phase)
        p, q, r, s = self[i - 1], self[i], self[i + 1], self[i + 2]
        if self._first < i - 1 - _KEPT:
            self._forget(i - 1 - _KEPT)
        if p == q == r == s:
            return s
        at: Vector = self._between(p, q, r, s, phase - i)
        return at

    def rests(self, phase: float) -> bool:
        """True where the curve stands on the newest row."""
        i, last = math.floor(phase), self.last
        return self[i - 1] == last and self[i] == last and self[i + 1] == last and self[i + 2] == last

    def __missing__(self, number: int) -> Vector:
        """A row before the first, or one that is expected: it is used from now on."""
        if number < self._first:
            return self._oldest
        row = self[number] = self._expected(number - self.newest)
        return row

    def _expected(self, on: int) -> Vector:
        """The row that comes ``on`` rows after the newest, on the way from rows that were used."""
        straight = tuple([b + on * (b - a) for a, b in zip(self.before, self.last, strict=True)])
        if self._rules < 4:
            return straight
        farthest = _FARTHEST
        if self._rules > 9 and self._period_s:
            farthest = max(farthest, round(_FARTHEST_S / self._period_s))
        if on > farthest:
            return self[self.newest + farthest]
        over = max(_LEAST_BEND, round(BEND_S / self._period_s)) if self._period_s else _LEAST_BEND
        if self._rules > 5:  # rows before the first are none of the path
            over = min(over, (self.newest - self._first) // 2)
        row = straight if over == 0 else self._bent(straight, on, over)
        moved: Vector = self._ways.moved(row, self.newest + on)
        return moved

    def _bent(self, straight: Vector, on: int, over: int) -> Vector:
        """The row ``on`` rows straight on, moved by the second difference of the last rows."""
        share = 0.5 * on * (on + 1)
        bend = [share * agreed(near, far) for near, far in zip(self._bend(1), self._bend(over), strict=True)]
        size = math.hypot(*bend)
        most = _MOST_BEND * on * math.dist(self.before, self.last)
        bent = min(1.0, most / size) if size > 0.0 else 0.0
        return tuple([a + bent * b for a, b in zip(straight, bend, strict=True)])

    def _bend(self, over: int) -> Vector:
        """Second difference per row of the last rows that came, each ``over`` rows after the one before."""
        new, mid, old = (self._came.get(self.newest - k, self._oldest) for k in (0, over, 2 * over))
        return tuple([(a - 2.0 * b + c) / over**2 for a, b, c in zip(new, mid, old, strict=True)])

    def _forget(self, before: int) -> None:
        """Rows that the curve has left behind."""
        while self._first < before:
            row = self.pop(self._first, None)
            self._came.pop(self._first, None)
            if row is not None:
                self._oldest = row
            self._first += 1


def agreed(near: float, far: float) -> float:
    """The smaller of two second differences that have one sign, else 0: a corner is no bend."""
    return 0.0 if near * far <= 0.0 else min(near, far) if near > 0.0 else max(near, far)
