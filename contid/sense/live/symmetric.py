"""Symmetric 3 x 3 matrices, written out: a call of NumPy alone takes longer than these functions.

A matrix is ``(a, b, c, d, e, f)`` with the rows (a, b, c), (b, d, e), (c, e, f).
"""

from __future__ import annotations

from typing import TypeAlias

from contid.targets import Vec3

Symmetric: TypeAlias = tuple[float, float, float, float, float, float]


def cofactors(matrix: Symmetric) -> tuple[Symmetric, float]:
    """Cofactors, which are the inverse times the determinant, and the determinant."""
    a, b, c, d, e, f = matrix
    aa, bb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    return (aa, bb, cc, a * f - c * c, b * c - a * e, a * d - b * b), a * aa + b * bb + c * cc


def squared_distance(point: Vec3, spread: Symmetric) -> float:
    """``x^T S^-1 x`` of a point from the origin, in standard deviations of a covariance S."""
    x, y, z = point
    (a, b, c, d, e, f), determinant = cofactors(spread)
    return (a * x * x + d * y * y + f * z * z + 2.0 * (b * x * y + c * x * z + e * y * z)) / determinant
