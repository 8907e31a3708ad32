"""The boundary of the pressures whose path from rest is stable, next to a pose.

Beyond it the path leads to another equilibrium: the arm would snap. A descent needs the direction in which it
lies. Specification of ``contid/kernels/cosserat/along_branch/boundary.hpp``.
"""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.along_branch.ramp import BranchPose
from contid.kinematics.cosserat.box_step import box_step
from contid.kinematics.cosserat.solve import Problem
from contid.kinematics.cosserat.statics import sweep

#: Part of a rejected step to which steps are limited.
SHRINK = 0.25
#: The least part of a step that leads towards the boundary.
LEAST_APPROACH = 0.05
#: How weak the balance must be, as a part of where it is weakest.
NEARLY_WEAKEST = 0.5
#: Weight of the boundary in a step along it, in units of the trace of the task's matrix.
PLANE_WEIGHT = 1e4
#: Part of that on the diagonal, which keeps the matrix definite.
DEFINITE = 1e-13


def boundary_normal(problem: Problem, pose: BranchPose) -> Array | None:
    """Unit normal of the boundary, shape (3k,); None where there is no such direction.

    The pressures that change the moment balance in the direction in which it is weakest, at the first point
    of the path from rest where it is nearly as weak as anywhere on it.
    """
    points = []
    for part, moment in (*pose.ramp, (1.0, pose.base_moment)):
        loads = problem.loads.scaled(part)
        found = sweep(problem.rod, part * pose.pressures, moment, loads, problem.elements, tangents=True)
        assert found.tangents is not None
        try:
            compliance = np.linalg.inv(found.tangents.moment[:, :3])
        except np.linalg.LinAlgError:
            return None
        points.append((float(np.linalg.norm(compliance)), compliance, found.tangents.moment[:, 3:]))
    most = max(size for size, _, _ in points)
    _, compliance, by_pressure = next(point for point in points if point[0] >= NEARLY_WEAKEST * most)
    row = compliance[int(np.argmax(np.sum(compliance**2, axis=1)))]
    normal: Array = row @ by_pressure
    length = float(np.linalg.norm(normal))
    return normal / length if length > 0.0 else None


def limited_step(H: Array, g: Array, low: Array, high: Array, normal: Array, room: float) -> Array:
    """The bounded step that goes ``room`` [bar] towards the boundary."""
    weight = PLANE_WEIGHT * float(np.trace(H))
    stiff = H + weight * (np.outer(normal, normal) + DEFINITE * np.eye(len(g)))
    return box_step(stiff, g - weight * room * normal, low, high)
