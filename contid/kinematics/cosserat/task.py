"""Task of a rod, its error for a sweep, and the derivative of that error.

Rows are lengths [mm]; a direction or a frame enters times `Task.length`. Specification of
``contid/kernels/cosserat/task.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.closed_form import minimal_rotation
from contid.kinematics.cosserat.spatial import hat
from contid.kinematics.cosserat.statics import Sweep


@dataclass(frozen=True, slots=True)
class Task:
    """Target of a solve.

    Attributes:
        tip: tip position [mm].
        mid: end of the first section [mm], or None (mode b).
        direction: unit tangent of the tip, or None (mode c).
        full_rotation: the target is the whole frame, twist-free about ``direction`` (mode d, eq. 17).
        length: length that scales directions to mm.
    """

    tip: Array
    mid: Array | None = None
    direction: Array | None = None
    full_rotation: bool = False
    length: float = 42.0

    @property
    def rows(self) -> int:
        """Independent rows."""
        rotation = 0 if self.direction is None else (3 if self.full_rotation else 2)
        return 3 + (0 if self.mid is None else 3) + rotation


def twist_free(direction: Array) -> Array:
    """Rotation that tilts e3 to ``direction`` without twist, shape (3, 3): the R_d of mode (d)."""
    return minimal_rotation(np.array([0.0, 0.0, 1.0]), direction)


def residual(task: Task, found: Sweep) -> Array:
    """Task error of a sweep [mm]: three rows each for tip, mid-point and direction, as present."""
    rows = [found.tip - task.tip]
    if task.mid is not None:
        rows.append(found.ends[0] - task.mid)
    if task.direction is not None:
        if task.full_rotation:
            rows.append(task.length * 2.0 * _half_turn(task, found)[1])
        else:
            rows.append(task.length * (found.rotation[:, 2] - task.direction))
    return np.concatenate(rows)


def task_error(task: Task, found: Sweep) -> float:
    """Norm of `residual` [mm]."""
    return float(np.linalg.norm(residual(task, found)))


def _half_turn(task: Task, found: Sweep) -> tuple[float, Array]:
    """Quaternion (w, vector) of the rotation from the target to the found frame, w >= 0.

    Unlike the (R^T R_d - R_d^T R) of eq. 17 its vector part vanishes only at zero, not at half a turn too.
    """
    assert task.direction is not None
    q = found.rotation @ twist_free(task.direction).T
    w = 0.5 * np.sqrt(max(0.0, 1.0 + float(np.trace(q))))
    axis = np.array([q[2, 1] - q[1, 2], q[0, 2] - q[2, 0], q[1, 0] - q[0, 1]])
    return w, axis / (4.0 * max(w, 1e-9))


def jacobian(task: Task, found: Sweep) -> Array:
    """Derivative of `residual` by (base moment, pressures), shape (rows, 3 + 3k)."""
    tangents = found.tangents
    assert tangents is not None
    rows = [tangents.tip]
    if task.mid is not None:
        rows.append(tangents.ends[0])
    if task.direction is not None:
        if task.full_rotation:
            w, vector = _half_turn(task, found)
            rows.append(task.length * (w * np.eye(3) - hat(vector)) @ tangents.turn)
        else:
            rows.append(-task.length * hat(found.rotation[:, 2]) @ tangents.turn)
    return np.vstack(rows)
