"""Monotone piecewise cubic through a table (PCHIP), and its exact inverse.

On the cell ``[x_k, x_k + h]`` with ``s = (x - x_k) / h`` the Hermite form is

    y = y_k + s (h d_k + s ((3 dy - h (2 d_k + d_{k+1})) + s (h (d_k + d_{k+1}) - 2 dy)))

with slopes that are weighted harmonic means of the neighbouring secants (Fritsch and Butland, SIAM J. Sci.
Stat. Comput. 5, 300-304, 1984) and a limited three-point formula at the ends; ``scipy.interpolate`` builds
the same. A strictly monotone table gives a strictly monotone curve, so the inverse is unique; Newton's
method, kept inside a shrinking bracket, finds it. Plain floats: one evaluation costs less than the call of a
NumPy function.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise


class MonotoneCubic:
    """The curve through at least two points with strictly rising x and strictly monotone y.

    Outside the table both directions stay at its ends.
    """

    __slots__ = ("_cells", "_falling", "_x", "_y")

    def __init__(self, x: Sequence[float], y: Sequence[float]) -> None:
        steps = [(x1 - x0, y1 - y0) for (x0, y0), (x1, y1) in pairwise(zip(x, y, strict=True))]
        self._falling = steps[0][1] < 0
        slopes = _slopes(steps)
        self._x = tuple(x)
        self._y = tuple(y)
        self._cells = tuple(
            (x0, y0, h, h * d0, 3.0 * dy - h * (2.0 * d0 + d1), h * (d0 + d1) - 2.0 * dy)
            for x0, y0, (h, dy), (d0, d1) in zip(x, y, steps, pairwise(slopes), strict=False)
        )

    def __call__(self, x: float) -> float:
        """The curve at x."""
        if x <= self._x[0]:
            return self._y[0]
        if x >= self._x[-1]:
            return self._y[-1]
        x0, y0, h, c1, c2, c3 = self._cells[bisect_right(self._x, x) - 1]
        s = (x - x0) / h
        return y0 + s * (c1 + s * (c2 + s * c3))

    def inverse(self, y: float) -> float:
        """The x at which the curve has the value y, to the last bits of a double."""
        first, last = self._y[0], self._y[-1]
        if (y >= first) if self._falling else (y <= first):
            return self._x[0]
        if (y <= last) if self._falling else (y >= last):
            return self._x[-1]
        if self._falling:
            k = bisect_right(self._y, -y, key=lambda value: -value) - 1
        else:
            k = bisect_right(self._y, y) - 1
        x0, y0, h, c1, c2, c3 = self._cells[k]
        rise = c1 + c2 + c3
        low, high = 0.0, 1.0
        s = (y - y0) / rise
        for _ in range(80):
            error = y0 - y + s * (c1 + s * (c2 + s * c3))
            if error == 0.0:
                break
            if (error < 0.0) != (rise < 0.0):
                low = s
            else:
                high = s
            slope = c1 + s * (2.0 * c2 + 3.0 * s * c3)
            better = s - error / slope if slope != 0.0 else math.inf
            if not low < better < high:
                better = 0.5 * (low + high)
            if abs(better - s) <= 1e-16:
                break
            s = better
        return x0 + s * h


def _slopes(steps: Sequence[tuple[float, float]]) -> list[float]:
    """Derivative at every point of the table."""
    secants = [dy / h for h, dy in steps]
    if len(steps) == 1:
        return [secants[0], secants[0]]
    inner = []
    for (h0, _), (h1, _), d0, d1 in zip(steps, steps[1:], secants, secants[1:], strict=False):
        w0, w1 = 2.0 * h1 + h0, h1 + 2.0 * h0
        inner.append((w0 + w1) / (w0 / d0 + w1 / d1))
    first = _end_slope(steps[0][0], steps[1][0], secants[0], secants[1])
    last = _end_slope(steps[-1][0], steps[-2][0], secants[-1], secants[-2])
    return [first, *inner, last]


def _end_slope(h0: float, h1: float, d0: float, d1: float) -> float:
    """Three-point slope at an end, limited so that the end cell stays monotone (d0 and d1 have one sign)."""
    slope = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
    return 0.0 if (slope < 0.0) != (d0 < 0.0) else slope
