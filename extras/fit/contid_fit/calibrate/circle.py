"""Geometric circle fit that is regular for straight lines.

A circle or line is ``A (x^2 + y^2) + B x + C y + D = 0`` with ``B^2 + C^2 - 4 A D = 1``; its curvature
is ``2 A``, which passes through zero where a radius would pass through infinity. The signed distance of a
point is

    d = 2 P / (1 + sqrt(1 + 4 A P)),      P = A (x^2 + y^2) + B x + C y + D.

Pratt's algebraic fit starts, least squares of d finishes. Source: N. Chernov, "Circular and Linear
Regression", 2010, sections 3.2 and 5.13.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array


@dataclass(frozen=True, slots=True)
class CircleFit:
    """A circle through points, in the unit of the points.

    Attributes:
        curvature: not negative; 0 for a line.
        error_per_noise: standard error of the curvature per unit of noise on the points.
        rms: root mean square distance of the points from the circle.
    """

    curvature: float
    error_per_noise: float
    rms: float


def fit_circle(points: Array) -> CircleFit:
    """Fit a circle to points of shape ``(n, 2)``, n >= 3.

    Raises:
        ValueError: fewer than three different points.
    """
    from scipy.optimize import least_squares

    if len(np.unique(points, axis=0)) < 3:
        raise ValueError("a circle needs three different points")
    centre = points.mean(axis=0)
    # Unit size makes the parameters comparable and the squares harmless.
    size = float(np.sqrt(((points - centre) ** 2).sum(axis=1).mean()))
    x, y = ((points - centre) / size).T
    squares = x * x + y * y

    def distances(q: Array) -> Array:
        a, angle, d = q
        length = math.sqrt(max(1.0 + 4.0 * a * d, 1e-12))
        p = a * squares + length * (math.cos(angle) * x + math.sin(angle) * y) + d
        return np.asarray(2.0 * p / (1.0 + np.sqrt(np.maximum(1.0 + 4.0 * a * p, 1e-12))))

    found = least_squares(distances, _pratt(x, y, squares), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    covariance = np.linalg.pinv(found.jac.T @ found.jac)
    return CircleFit(
        curvature=abs(2.0 * float(found.x[0])) / size,
        error_per_noise=2.0 * math.sqrt(max(float(covariance[0, 0]), 0.0)) / size**2,
        rms=math.sqrt(float(np.mean(found.fun**2))) * size,
    )


def _pratt(x: Array, y: Array, squares: Array) -> Array:
    """Algebraic fit under Pratt's constraint, as (A, angle of (B, C), D)."""
    design = np.column_stack([squares, x, y, np.ones_like(x)])
    constraint = np.zeros((4, 4))
    constraint[1, 1] = constraint[2, 2] = 1.0
    constraint[0, 3] = constraint[3, 0] = -2.0
    values, vectors = np.linalg.eig(np.linalg.solve(constraint, design.T @ design))
    values, vectors = values.real, vectors.real
    # The least non-negative eigenvalue; rounding may push an exact fit's zero below it.
    usable = np.where(values > -1e-9 * np.abs(values).max(), values, np.inf)
    a, b, c, d = vectors[:, int(np.argmin(usable))]
    norm = math.sqrt(max(b * b + c * c - 4.0 * a * d, 1e-300))
    a, b, c, d = a / norm, b / norm, c / norm, d / norm
    return np.array([a, math.atan2(c, b), d])
