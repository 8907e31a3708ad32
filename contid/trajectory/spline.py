"""Curves through rows: piecewise polynomials, computed once.

Cubic: Overhauser's parabolic blending (Hermite form). The slope at a row is that of the parabola through it
and its neighbours at their own times, at the ends the one-sided slope of the same parabola,

    m_i = (h_i d_{i-1} + h_{i-1} d_i) / (h_{i-1} + h_i),   d_i = (p_{i+1} - p_i) / h_i,   m_0 = 2 d_0 - m_1,

so the curve is C1, passes through every row, is exact for parabolas, converges with the third power of the
spacing, and a row moves only the four intervals around it. (A C2 spline would ring after a corner.) Where a
robot stands still between two rows its slopes are zero: a dwell stays a dwell.

Every slope is bounded, per column, by its two neighbouring rows,

    |m_i| <= TENSION max(|p_i - p_{i-1}|, |p_{i+1} - p_i|) / max(h_{i-1}, h_i),

because without it two rows close in time, but not in position, give a slope that the next long interval
multiplies by its length. Slopes add at most ``u (1 - u) h max|m|`` to the blend of two rows, so the curve
leaves the range of the two rows by at most ``TENSION / 4`` of the greatest distance among neighbouring rows.
The bound never acts on even spacing, and on smooth curves only at turning points between intervals that
differ by about a factor 2 or more.

Source: A. W. Overhauser, "Analytic definition of curves and surfaces by parabolic blending", Ford Motor
Company SL68-40, 1968; for non-uniform times the slopes are Bessel's (C. de Boor, "A Practical Guide to
Splines", ch. IV).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Bound of the slopes. On even spacing slopes stay below 2 by themselves, at the ends too.
TENSION: Final = 2.0


def linear(times: Floats, rows: Floats) -> Floats:
    """Coefficients of straight lines from row to row, see `cubic`."""
    coefficients = np.zeros((len(times) - 1, 4, rows.shape[1]))
    coefficients[:, 0] = rows[:-1]
    coefficients[:, 1] = np.diff(rows, axis=0) / np.diff(times)[:, None]
    return coefficients


def cubic(times: Floats, rows: Floats) -> Floats:
    """Coefficients of the cubic through the rows of one robot.

    Args:
        times: strictly increasing, shape ``(n,)`` with n >= 2.
        rows: shape ``(n, columns)``; all of one robot.

    Returns:
        ``c`` of shape ``(n - 1, 4, columns)`` with ``p(t) = c0 + c1 u + c2 u^2 + c3 u^3``, ``u = t - t_i``.
    """
    if len(times) == 2:
        return linear(times, rows)
    steps = np.diff(times)[:, None]
    chords = np.diff(rows, axis=0) / steps
    slopes = np.empty_like(rows)
    slopes[1:-1] = (steps[1:] * chords[:-1] + steps[:-1] * chords[1:]) / (steps[1:] + steps[:-1])
    slopes[0] = 2.0 * chords[0] - slopes[1]
    slopes[-1] = 2.0 * chords[-1] - slopes[-2]
    jumps = np.abs(np.diff(rows, axis=0))
    bound = TENSION * np.maximum(jumps[1:], jumps[:-1]) / np.maximum(steps[1:], steps[:-1])
    bound = np.concatenate([bound[:1], bound, bound[-1:]])
    slopes = np.clip(slopes, -bound, bound)
    still = np.flatnonzero(~np.any(chords, axis=1))
    slopes[still] = slopes[still + 1] = 0.0
    coefficients = np.empty((len(times) - 1, 4, rows.shape[1]))
    coefficients[:, 0] = rows[:-1]
    coefficients[:, 1] = slopes[:-1]
    coefficients[:, 2] = (3.0 * chords - 2.0 * slopes[:-1] - slopes[1:]) / steps
    coefficients[:, 3] = (slopes[:-1] + slopes[1:] - 2.0 * chords) / steps**2
    return coefficients
