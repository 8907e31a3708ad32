"""Goal of a chain of sections, its error rows [m] and derivatives, and the numbers of its solver.

The rows are the tip error, the mid-point error, and ``ell (t_target - t)`` for a direction, or ``ell phi``
with ``exp(phi) R = R_target`` for a rotation. Specification of ``section_task.hpp``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.sections import ArcChain, differentiate
from contid.kinematics.array import Array
from contid.targets import Vec3


@dataclass(frozen=True, slots=True)
class Tuning:
    """Numbers of the solver.

    Attributes:
        ell_m: length that scales damping and direction rows [m].
        tolerance_m: error at which a target is met [m].
        home_tolerance_m: step at which the redundancy counts as settled [m].
        weight: w, least damping, and bound of the multipliers where the task is singular.
        near: homing starts below ``near * ell_m`` of error.
        home_steps: maximum number of homing steps; twice as many near obstacles.
        contraction: where homing steps shrink less than by this factor, their metric gets the curvature.
        slow: a damped step that leaves more than this share of the error ends the approach.
        iterations: maximum number of damped steps per start.
        settling: maximum number of Newton steps per start, for a target that is not met.
        starts: maximum number of starts after the seed, for a target that is not met.
        agreeing: number of starts ending at the best answer that ends the search for a target beyond the
            length of the arm; within its length every start is tried.
        tracking: a descent from the seed that moves less than ``tracking * ell_m`` without meeting its target
            follows a bounded optimum from tick to tick: then at most ``agreeing`` starts, to stay in time.
        still_m: a seed that meets its target within ``still_error_m`` [m] is kept where the first step is
            shorter [m]: an answer solved again from itself does not move.
        still_error_m: see ``still_m``.
    """

    ell_m: float
    tolerance_m: float = 1e-6
    home_tolerance_m: float = 1e-8
    weight: float = 1e-8
    near: float = 0.3
    home_steps: int = 60
    contraction: float = 0.3
    slow: float = 0.95
    iterations: int = 60
    settling: int = 80
    starts: int = 32
    agreeing: int = 3
    tracking: float = 0.1
    still_m: float = 1e-8
    still_error_m: float = 1e-10


def tuning_for(feasible: Feasible) -> Tuning:
    """Numbers scaled to the size of the robot: ``ell`` is a fifth of the arm in its home posture."""
    return Tuning(ell_m=0.2 * (float(feasible.home.sum()) / 3.0 + sum(feasible.sections.rigid_m)))


class Goal(NamedTuple):
    """Tip, and optionally unit tangent, frame (row by row) or mid-point, in the base frame [m]."""

    tip: Vec3
    direction: Vec3 | None = None
    mid: Vec3 | None = None
    rotation: tuple[float, ...] | None = None


def turn_left(target: Array, at: Array) -> Array:
    """Rotation vector phi [rad] with ``exp(phi) at = target``, at most half a turn."""
    r = target @ at.T
    v = 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    s, c = math.sqrt(float(v @ v)), 0.5 * (float(np.trace(r)) - 1.0)
    if s > 1e-6:
        return np.asarray(math.atan2(s, c) / s * v)
    if c > 0.0:
        return v
    k = int(np.argmax(np.diag(r)))  # half a turn: R + 1 = 2 axis axis^T
    size = math.sqrt(max(0.5 * (float(r[k, k]) + 1.0), 1e-300))
    axis = 0.25 * (r[:, k] + r[k]) / size
    axis[k] = size
    return np.asarray(math.pi * axis)


def task(sections: ArcChain, ell_m: float, lengths: Array, goal: Goal) -> tuple[Array, Array]:
    """Error rows ``(m,)`` [m] and their Jacobian ``(m, 3 n)`` at ``lengths``."""
    at = differentiate(sections, lengths)
    errors, rows = [np.array(goal.tip) - at.frames.tip], [at.tip]
    if goal.direction is not None:
        tangent = at.frames.rotation[:, 2]
        errors.append(ell_m * (np.array(goal.direction) - tangent))
        rows.append(ell_m * np.cross(at.spin, tangent[:, None], axis=0))
    if goal.rotation is not None:
        errors.append(ell_m * turn_left(np.reshape(goal.rotation, (3, 3)), at.frames.rotation))
        rows.append(ell_m * at.spin)  # the gradient of |phi|^2/2 is exact: phi is an eigenvector of d exp
    if goal.mid is not None:
        errors.append(np.array(goal.mid) - at.frames.mid)
        rows.append(at.mid)
    return np.concatenate(errors), np.vstack(rows)
