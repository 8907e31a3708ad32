"""Algorithm 1 of Morita et al.: Levenberg-Marquardt for the finger, kept as an independent check.

    e = p_d - p(q)        dq = (J^T W J + lambda I)^-1 J^T W e        W = diag(1, 1/(2 pi))      (Eq. 7)

In q = (k, S) instead of the paper's (r, theta), whose Jacobian is singular on the straight line
(``det J = -x``). The weight of the paper multiplies the error, which is two lengths, so it only bends the
path of the iteration. J is evaluated anew in every step, which the paper leaves open. It is never used in
the loop: the closed form of `contid.kinematics.rack.finger` is exact and forty times faster.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.rack.planar_arc import cosc, cosc_derivative, sinc, sinc_derivative

PAPER_WEIGHT: Final = (1.0, 1.0 / (2.0 * math.pi))


@dataclass(frozen=True, slots=True)
class LevenbergMarquardtResult:
    """Where the iteration ended: arc length [mm], curvature [1/mm], |p_d - p| [mm], steps taken."""

    arc_length_mm: float
    curvature_per_mm: float
    error_mm: float
    iterations: int
    converged: bool


def _tip_and_jacobian(curvature: float, arc_length: float, tip_length: float) -> tuple[Array, Array]:
    theta = curvature * arc_length
    sin, cos = math.sin(theta), math.cos(theta)
    tip = np.array([arc_length * cosc(theta) + tip_length * sin, arc_length * sinc(theta) + tip_length * cos])
    by_theta = np.array(
        [
            arc_length * cosc_derivative(theta) + tip_length * cos,
            arc_length * sinc_derivative(theta) - tip_length * sin,
        ]
    )
    by_curvature = by_theta * arc_length
    by_length = np.array([cosc(theta), sinc(theta)]) + by_theta * curvature
    return tip, np.column_stack([by_curvature, by_length])


def solve(
    x_mm: float,
    y_mm: float,
    tip_length_mm: float,
    *,
    start: tuple[float, float] = (0.01, 50.0),
    damping: float = 1e-3,
    tolerance_mm: float = 1e-6,
    max_iterations: int = 500,
    weight: tuple[float, float] = PAPER_WEIGHT,
) -> LevenbergMarquardtResult:
    """Run Algorithm 1 from ``start`` = (curvature [1/mm], arc length [mm]); lambda is not printed: 1e-3.

    Works in mm, as the paper does: lambda compares with squared millimetres.
    """
    q = np.array(start, dtype=float)
    target = np.array([x_mm, y_mm])
    W = np.diag(weight)
    for iteration in range(max_iterations + 1):
        tip, J = _tip_and_jacobian(float(q[0]), float(q[1]), tip_length_mm)
        error = target - tip
        distance = float(np.hypot(*error))
        if distance < tolerance_mm or iteration == max_iterations or not math.isfinite(distance):
            break
        q = q + np.linalg.solve(J.T @ W @ J + damping * np.eye(2), J.T @ W @ error)
    return LevenbergMarquardtResult(
        float(q[1]), float(q[0]), distance, iteration, converged=distance < tolerance_mm
    )
