"""The bounded step: a strictly convex quadratic programme over a convex set, by the dual active-set method.

    minimise  1/2 (d - d0)^T H (d - d0)   subject to   l + d feasible,   d0 the step without limits

Goldfarb and Idnani (1983): start at the unconstrained minimum, add the limit exceeded most, drop limits whose
multiplier would change sign, until nothing is exceeded. The limits are asked for one by one, at the present
point, so a curved limit (the cone of the bend radius) is met by as many tangent planes as it takes. When no
limit is exceeded the cost is one factor of the size of the task: ``d = z + J^T (J J^T + w)^-1 (e - J z)``,
which also keeps the digits of the part of z that leaves the task alone. The specification of
``contid/kernels/convex_step.hpp``.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from contid.models.arc import Array
from contid.models.feasible import Feasible

# Excess that counts as rounding [m]; the caller pulls the rest inside.
_ROUNDING_M: Final = 1e-12
_LIMITS_TRIED: Final = 40


def cholesky(H: Array) -> Array:
    """Lower factor; raises ``np.linalg.LinAlgError`` unless H is positive definite."""
    return np.asarray(np.linalg.cholesky(H), dtype=np.float64)


def damped_step(J: Array, e: Array, weight: float, z: Array, at: Array, feasible: Feasible) -> Array:
    """Minimise ``|J d - e|^2 + weight |d - z|^2`` within the limits.

    Shapes ``(m, N)``, ``(m,)``, scalar, ``(N,)``, ``(N,)``. Without limits the answer takes one factor of the
    size of the task, ``d = z + J^T (J J^T + w)^-1 (e - J z)``, which also keeps the digits of the part of z
    that leaves the task alone; only a limit in the way costs a factor of the size of the arm.
    """
    d: Array = z + J.T @ np.linalg.solve(J @ J.T + weight * np.eye(len(e)), e - J @ z)
    if feasible.worst(at + d, ())[0] <= _ROUNDING_M:
        return d
    factor = cholesky(J.T @ J + weight * np.eye(len(at)))
    return bounded_step(factor, d, at, feasible)


def bounded_step(factor: Array, d: Array, at: Array, feasible: Feasible) -> Array:
    """The step closest to ``d`` in the metric H within the limits; ``factor``: H's lower Cholesky factor."""
    excess, normal, number = feasible.worst(at + d, ())
    if excess <= _ROUNDING_M:
        return d
    whiten = np.linalg.inv(factor)
    held: list[int] = []
    normals = np.empty((0, len(at)))  # of the held limits, whitened
    multipliers = np.empty(0)
    for _ in range(_LIMITS_TRIED):
        v = whiten @ normal
        added = 0.0
        while True:
            r = np.linalg.solve(normals @ normals.T, normals @ v) if held else np.empty(0)
            move = v - normals.T @ r
            gain = float(move @ move)
            full = excess / gain if gain > 1e-14 * float(v @ v) and len(held) < len(at) else math.inf
            ratios = np.where(r > 0.0, multipliers / np.where(r > 0.0, r, 1.0), math.inf)
            blocking = int(np.argmin(ratios)) if held else -1
            partial = float(ratios[blocking]) if held else math.inf
            t = min(full, partial)
            if t == math.inf:  # this limit depends on the held ones: what is left of it is rounding
                return d
            multipliers = multipliers - t * r
            added += t
            if full < math.inf:
                d = d - t * (whiten.T @ move)
                excess -= t * gain
            if full <= partial:
                held.append(number)
                normals = np.vstack((normals, v))
                multipliers = np.append(multipliers, added)
                break
            held.pop(blocking)
            normals = np.delete(normals, blocking, axis=0)
            multipliers = np.delete(multipliers, blocking)
        excess, normal, number = feasible.worst(at + d, held)
        if excess <= _ROUNDING_M:
            break
    return d
