"""Jacobian methods in NumPy: transpose, pseudo-inverse, damped least squares, virtual variable length.

Each is a generator that starts at the straight arm and gives the bend vectors ``(segments, 2)`` [rad] after
every iteration; the caller stops it, or it is given up. None has limits.

* Transpose: ``J^T e`` with the step that is best for the linearised error.
* Pseudo-inverse: the step of least norm, Newton's method; singular values below 1e-10 of the largest are
  cut.
* Damped least squares: ``J^T (J J^T + lambda^2 I)^-1 e`` with a constant lambda (J is metres per metre).
* Virtual variable length (Feng, Renda et al.): segments get a length of their own while iterating. The text
  read here is the abstract, which leaves open how the lengths return. Here they are variables of the
  damped step, drawn to the real length by a weight that doubles in every iteration; the bends given are
  those of the real lengths.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from contid.kinematics.arc.sections import ArcChain
from contid.kinematics.array import Array
from studies.arc_chains import Goal, task
from studies.segment_arms import SegmentArm

#: lambda with virtual lengths: of 0.5, 0.2, 0.1, 0.03 and 0.01 the one that fails least (other poses).
DAMPING: Final = 0.2
#: Weight of the lengths in the first iteration, its growth, and its largest value.
FIRST_WEIGHT: Final = 0.03
GROWTH: Final = 2.0
LARGEST_WEIGHT: Final = 1e4
#: Largest bend times length: next to singular Jacobians the step of least norm runs away, and is given up.
RUN_AWAY_M: Final = 1e3


def transpose(arm: SegmentArm, goal: Goal) -> Iterator[Array]:
    """Steepest descent of the pose error."""
    x = np.zeros(2 * arm.count)
    while True:
        e, J = task(arm.sections, arm.ell_m, x, goal)
        slope = J.T @ e
        moved = J @ slope
        square = float(moved @ moved)
        if square > 0.0:
            x = x + float(e @ moved) / square * slope
        yield _bends(arm, x)


def pseudo_inverse(arm: SegmentArm, goal: Goal) -> Iterator[Array]:
    """Newton's method with the step of least norm."""
    x = np.zeros(2 * arm.count)
    while True:
        e, J = task(arm.sections, arm.ell_m, x, goal)
        x = x + np.linalg.pinv(J, rcond=1e-10) @ e
        if not float(np.max(np.abs(x))) < RUN_AWAY_M:
            return
        yield _bends(arm, x)


def damped_least_squares(arm: SegmentArm, goal: Goal, damping: float = DAMPING) -> Iterator[Array]:
    """The damped step with a constant lambda."""
    x = np.zeros(2 * arm.count)
    while True:
        e, J = task(arm.sections, arm.ell_m, x, goal)
        x = x + J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(len(e)), e)
        yield _bends(arm, x)


class VariableLengths(ArcChain):
    """A chain whose variables are bend vectors times the real length, and lengths: three per segment [m]."""

    def __init__(self, arm: SegmentArm) -> None:
        self.rigid_m = (0.0,) * arm.count
        each = np.diag((1.0 / arm.length_m, 1.0 / arm.length_m, 1.0))
        self.to_arc = np.broadcast_to(each, (arm.count, 3, 3))

    def arcs(self, lengths: Array | Sequence[float]) -> Array:
        """Bend vectors and lengths ``(count, 3)``."""
        arcs: Array = np.einsum("nij,nj->ni", self.to_arc, np.asarray(lengths).reshape(self.count, 3))
        return arcs


def virtual_variable_length(arm: SegmentArm, goal: Goal) -> Iterator[Array]:
    """Damped least squares with lengths that return to the real ones."""
    chain = VariableLengths(arm)
    is_length = np.tile((False, False, True), arm.count)
    x = np.where(is_length, arm.length_m, 0.0)
    weight = FIRST_WEIGHT
    while True:
        e, J = task(chain, arm.ell_m, x, goal)
        back = np.where(is_length, weight**2 * (arm.length_m - x), 0.0)
        damping = np.where(is_length, weight**2, DAMPING**2)
        x = x + np.linalg.solve(J.T @ J + np.diag(damping), J.T @ e + back)
        weight = min(GROWTH * weight, LARGEST_WEIGHT)
        yield _bends(arm, x[~is_length])


def _bends(arm: SegmentArm, x: Array) -> Array:
    return np.asarray(x.reshape(arm.count, 2) / arm.length_m)
