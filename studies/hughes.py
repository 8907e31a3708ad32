"""The tri-rack inverse kinematics of Hughes et al., Eq. 4-6: a dynamical system with the answer at rest.

    minimise |x_d - h(Delta)|  subject to  L in [lower, upper],        Delta = M L
    Delta' = J_set^+ e_set + (I - J_set^+ J_set) J^+ (x_d - h(Delta))                     (Eq. 5)

Three variants, all with the corrected M of `contid.kinematics.arc.sections`:

* PRINTED: ``J_set`` takes rows of the identity *in Delta*, which are the Jacobian of the limits in L, and the
  push is plus or minus a column of M (in mm/s), as printed. It does not keep the limits.
* CORRECTED: ``J_set`` takes rows of M^-1 and ``e_set`` is bound minus length. Limits hold, but with N the
  projector of Eq. 5 the rest points obey ``N J^+ e = 0``, which is not optimality (``N J^T e = 0``): outside
  the workspace it stops far from the best answer.
* FULL: works in L; a limit is active while it is reached and the multiplier points outwards, the others
  follow a damped pseudo-inverse of their own columns. Its rest points are those of Eq. 4.

``printed_m`` is Eq. 3 as typeset: its entry (2, 3) has the wrong sign, which makes it singular at phi = 0,
120, 180 and 300 degrees - at 180, the phi of the paper's experiments, Eq. 5 as printed cannot be evaluated at
all.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.array import Array
from studies.arc_chains import differentiate

# The printed push is a column of M per second, in the paper's millimetres.
_PUSH_M = 1e-3
# Damping of the full variant and greatest change of a length per unit of time, where columns lose rank.
_DAMPING = 1e-2
_FASTEST_M = 0.2


class Variant(enum.StrEnum):
    """Which reading of Eq. 5."""

    PRINTED = "printed"
    CORRECTED = "corrected"
    FULL = "full"


@dataclass(frozen=True, slots=True)
class RestState:
    """Where the dynamics ended: lengths and error [m], Euler steps taken, whether it came to rest."""

    lengths_m: Array
    error_m: float
    steps: int
    settled: bool


def printed_m(phi_rad: float) -> Array:
    """Eq. 3 as printed, shape (3, 3)."""
    c, s = math.cos, math.sin
    third = math.pi / 3.0
    return np.array(
        [
            [-2.0 * c(phi_rad) / 3.0, 2.0 * c(phi_rad + third) / 3.0, 2.0 * c(phi_rad - third) / 3.0],
            [2.0 * s(phi_rad) / 3.0, -2.0 * s(phi_rad + third) / 3.0, 2.0 * s(phi_rad - third) / 3.0],
            [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0],
        ]
    )


def settle(
    feasible: Feasible,
    target_m: Array,
    start_m: Array,
    variant: Variant = Variant.FULL,
    dt: float = 0.1,
    most: int = 1200,
    rest_m: float = 1e-9,
) -> RestState:
    """Integrate Eq. 5 with Euler steps of ``dt`` from lengths ``start_m`` until nothing moves any more.

    Args:
        feasible: the arm and its interval of lengths; other limits did not exist in the paper.
        target_m: x_d, shape (3,) [m].
        start_m: lengths at the start, shape (3 n,) [m].
        variant: which reading of the equation.
        dt: step; the gain is 1, so an error decays like exp(-t).
        most: greatest number of steps.
        rest_m: change per unit of time that counts as rest [m].
    """
    lengths = np.array(start_m, dtype=np.float64)
    error = math.inf
    for step in range(most):
        at = differentiate(feasible.sections, lengths)
        e = target_m - at.frames.tip
        error = float(np.linalg.norm(e))
        rate = _rate(feasible, lengths, at.tip, e, variant)
        if float(np.abs(rate).max()) < rest_m:
            return RestState(lengths, error, step, True)
        lengths = lengths + dt * rate
    return RestState(lengths, error, most, False)


def _rate(feasible: Feasible, lengths: Array, J: Array, e: Array, variant: Variant) -> Array:
    """dL/dt of one variant."""
    if variant is Variant.FULL:
        return _full_rate(feasible, lengths, J, e)
    M = _m(feasible)
    inverse = np.linalg.inv(M)
    wish = np.linalg.pinv(J @ inverse) @ e
    below, above = lengths < feasible.low, lengths > feasible.high
    out = np.flatnonzero(below | above)
    if len(out) == 0:
        return np.asarray(inverse @ wish)
    if variant is Variant.PRINTED:
        push = _PUSH_M * (M[:, below].sum(axis=1) - M[:, above].sum(axis=1))
        free = np.ones(len(lengths))
        free[out] = 0.0
        return np.asarray(inverse @ (push + free * wish))
    rows = inverse[out]
    bound = np.where(below, feasible.low, feasible.high)[out]
    across = np.linalg.pinv(rows)
    return np.asarray(inverse @ (across @ (bound - lengths[out]) + wish - across @ (rows @ wish)))


def _full_rate(feasible: Feasible, lengths: Array, J: Array, e: Array) -> Array:
    """Lengths at a limit whose multiplier points outwards return to it, the others reduce the error."""
    near = 1e-9
    downhill = J.T @ e
    held = (lengths >= feasible.high - near) & (downhill > 0.0)
    held |= (lengths <= feasible.low + near) & (downhill < 0.0)
    rate = np.clip(lengths, feasible.low, feasible.high) - lengths
    F = J[:, ~held]
    rate[~held] += F.T @ np.linalg.solve(F @ F.T + _DAMPING**2 * np.eye(3), e)
    return rate * min(1.0, _FASTEST_M / max(float(np.abs(rate).max()), 1e-300))


def _m(feasible: Feasible) -> Array:
    """Delta = M L with Delta = (rho u, rho v, S) per segment, block diagonal."""
    sections = feasible.sections
    M = np.zeros((3 * sections.count, 3 * sections.count))
    for i, rho in enumerate(sections.radius_m):
        M[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = np.diag((rho, rho, 1.0)) @ sections.to_arc[i]
    return M
