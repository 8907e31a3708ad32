"""The bounded step: a strictly convex quadratic programme over a convex set, by the dual active-set method.

    minimise  1/2 (d - d0)^T H (d - d0)   subject to   l + d feasible,   d0 the step without limits

Goldfarb and Idnani (1983): start at the unconstrained minimum, add the limit exceeded most, drop limits whose
multiplier would change sign, until nothing is exceeded. Each limit is linearised at the present point, so a
curved one (the cone of the bend radius) is met by several tangent planes. Specification of
``contid/kernels/arc/active_set.hpp``.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from contid.kinematics.arc.feasible import BoundedChain, TangentLimits
from contid.kinematics.array import Array

# Excess that counts as rounding [m]; the caller pulls the rest inside.
_ROUNDING_M: Final = 1e-12
_LIMITS_TRIED: Final = 40


def cholesky(H: Array) -> Array:
    """Lower factor ``(n, n)`` of H; raises ``np.linalg.LinAlgError`` unless it is positive definite."""
    return np.asarray(np.linalg.cholesky(H), dtype=np.float64)


def solve(matrix: Array, right: Array) -> Array:
    """``matrix^-1 right``, of the shape of ``right``."""
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)


def damped_step(
    J: Array, e: Array, weight: float, at: Array, feasible: BoundedChain, factor: Array | None = None
) -> Array:
    """The step ``(N,)`` that minimises ``|J d - e|^2 + weight d^T W d`` within the limits.

    Without active limits ``d = W^-1 J^T y`` with ``(J W^-1 J^T + weight) y = e``: the matrix to be factored
    has the size of the task.

    Args:
        J: Jacobian of the task ``(m, N)``.
        e: its error ``(m,)``.
        weight: of the damping.
        at: where the step starts, inside the limits ``(N,)``.
        feasible: the limits.
        factor: lower Cholesky factor of W; None for the identity.
    """
    if factor is None:
        factor = np.eye(len(at))
    K = solve(factor, J.T).T
    y = solve(K @ K.T + weight * np.eye(len(e)), e)
    return bounded_step(factor, solve(factor.T, K.T @ y), at, feasible, K, weight)


def bounded_step(
    factor: Array,
    d: Array,
    at: Array,
    limits: BoundedChain | TangentLimits,
    rows: Array | None = None,
    weight: float = 0.0,
    cones: Array | None = None,
) -> Array:
    """The best step within the limits, from the best one without.

    Args:
        factor: lower Cholesky factor of the metric.
        d: the step without limits.
        at: where it starts, inside the limits.
        limits: those of the arm, or their tangents at one point.
        rows: Jacobian of a task, whitened by the factor, whose error counts ``1/weight``. Each row is held as
            an equation with a slack, ``(row, sqrt(weight) e_a)``, which keeps a stiff task well conditioned.
        weight: see ``rows``.
        cones: gets the sum of the multipliers of each section's cone, ``(sections,)``.
    """
    if limits.worst(at + d, ())[0] <= _ROUNDING_M:
        return d
    size = len(at)
    fixed = 0 if rows is None else len(rows)
    normals = np.zeros((fixed, size + fixed))  # of what is held, whitened
    if rows is not None:
        normals[:, :size] = rows
        normals[:, size:] = math.sqrt(weight) * np.eye(fixed)
    d, held, multipliers = _hold_limits(factor, d, at, limits, normals, fixed)
    if cones is not None:
        for number, multiplier in zip(held, multipliers, strict=True):
            if number >= limits.flat:
                cones[number - limits.flat] += multiplier
    return d


def _hold_limits(
    factor: Array, d: Array, at: Array, limits: BoundedChain | TangentLimits, normals: Array, fixed: int
) -> tuple[Array, list[int], Array]:
    """Hold limits until ``at + d`` is feasible: the step, the numbers of the limits and their multipliers."""
    size = len(at)
    excess, normal, number = limits.worst(at + d, ())
    held: list[int] = []
    multipliers = np.empty(0)
    for _ in range(_LIMITS_TRIED):
        v = np.concatenate((solve(factor, normal), np.zeros(fixed)))
        added = 0.0
        while True:
            r = solve(normals @ normals.T, normals @ v) if len(normals) else np.empty(0)
            move = v - normals.T @ r
            gain = float(move @ move)
            room = len(normals) < size + fixed
            full = excess / gain if room and gain > 1e-14 * float(v @ v) else math.inf
            partial, blocking = math.inf, -1
            for k, ratio in enumerate(r[fixed:]):
                if ratio > 0.0 and multipliers[k] / ratio < partial:
                    partial, blocking = float(multipliers[k] / ratio), k
            t = min(full, partial)
            if t == math.inf:  # linearly dependent on the held ones: the excess left is rounding
                return d, held, multipliers
            multipliers = multipliers - t * r[fixed:]
            added += t
            if full < math.inf:
                d = d - t * solve(factor.T, move[:size])
                excess -= t * gain
            if full <= partial:
                held.append(number)
                normals = np.vstack((normals, v))
                multipliers = np.append(multipliers, added)
                break
            held.pop(blocking)
            normals = np.delete(normals, fixed + blocking, axis=0)
            multipliers = np.delete(multipliers, blocking)
        excess, normal, number = limits.worst(at + d, held)
        if excess <= _ROUNDING_M:
            break
    return d, held, multipliers
