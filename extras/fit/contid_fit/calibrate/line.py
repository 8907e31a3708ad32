"""A straight line through values of different, partly known accuracy.

Each value has a known variance v of its own, and all have an unknown one tau^2 in common,

    y = a x + b + noise,      variance of the noise v + tau^2,      weight w = 1/(v + tau^2),

with the tau^2 >= 0 for which the weighted residuals have their expected size, ``sum w r^2 = n - 2``.
Residuals smaller than the known variances predict do not reduce the standard errors.

Source: R. C. Paule, J. Mandel, "Consensus Values and Weighting Factors", J. Res. Natl. Bur. Stand. 87, 1982;
quantiles of t: G. Knapp, J. Hartung, Stat. Med. 22, 2003.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from contid.kinematics.array import Array

#: Smallest variance, relative to the values' squares: rounding.
_ROUNDING: Final = 1e-24
_HALVINGS: Final = 60


def fit_line(x: Array, y: Array, variances: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Slope and intercept, and their standard errors; Student's t applies with n - 2 degrees of freedom.

    Args:
        x: shape ``(n,)``, n >= 3, not all equal.
        y: shape ``(n,)``.
        variances: v, shape ``(n,)``; zeros give equal weights.
    """
    known = variances + _ROUNDING * (float(np.mean(y * y)) or 1.0)
    freedom = len(x) - 2
    low, high = 0.0, float(np.sum(y * y))
    common = 0.0
    if _weighted(x, y, known)[2] > freedom:
        for _ in range(_HALVINGS):
            common = 0.5 * (low + high)
            low, high = (common, high) if _weighted(x, y, known + common)[2] > freedom else (low, common)
    line, covariance, chi2 = _weighted(x, y, known + common)
    a_error, b_error = np.sqrt(np.diag(covariance) * max(1.0, chi2 / freedom)).tolist()
    return (float(line[0]), float(line[1])), (a_error, b_error)


def _weighted(x: Array, y: Array, variances: Array) -> tuple[Array, Array, float]:
    """Line, its covariance for these variances, and the sum of the weighted squares of the residuals."""
    scale = 1.0 / np.sqrt(variances)
    rows = np.column_stack([x, np.ones_like(x)]) * scale[:, None]
    factor, triangle = np.linalg.qr(rows)
    line = np.linalg.solve(triangle, factor.T @ (y * scale))
    inverse = np.linalg.inv(triangle)
    residuals = y * scale - rows @ line
    return line, inverse @ inverse.T, math.fsum((residuals * residuals).tolist())
