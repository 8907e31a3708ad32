"""One descent of the bounded inverse kinematics: damped steps, homing, and Newton out of reach.

The rows of a task are lengths: tip error, mid-point error, and ``ell (t_target - t)`` for a direction. A step
solves a quadratic programme over the limits (`active_set`), never clips:

* far from the target:   min |J d - e|^2 + (w + mu |e|^2 / (2 ell^2)) |d|^2        (Sugihara's damping)
* near the target:       min |J d - e|^2 + w (d^T W d - 2 z^T d),  z towards the home posture
* not met:               min 1/2 d^T H d - (J^T e)^T d,  H the second derivative of |e|^2/2

The damping is scaled by the length ``ell``, a fifth of the arm: with errors in mm against singular values
near 1 the literature's ``lambda^2 = |e|^2/2`` stalls. Homing converges to the answer closest to home, so a
closed path closes in the lengths as well. Specification of ``descent.hpp``, ``newton.hpp`` and
``section_task.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from contid.kinematics.arc.active_set import bounded_step, cholesky, damped_step
from contid.kinematics.arc.feasible import BINDING_M, Feasible
from contid.kinematics.arc.sections import differentiate
from contid.kinematics.array import Array
from contid.targets import Vec3

# Central differences of the gradient [m]: 1e-10 of truncation, 1e-11 of rounding.
_DIFFERENCE_M: Final = 1e-5
# Forward differences of J^T y, which need few digits.
_FORWARD_M: Final = 1e-6
# A shift that makes any Hessian of an arm positive definite.
_MAX_SHIFT: Final = 1e12
_MIN_SHIFT: Final = 1e-3


@dataclass(frozen=True, slots=True)
class Tuning:
    """Numbers of the solver.

    Attributes:
        ell_m: length that scales damping and direction rows [m].
        tolerance_m: error at which a target is met [m].
        home_tolerance_m: step at which the redundancy counts as settled [m].
        weight: w, least damping and weight of homing; leaves ``w * 0.5 m / sigma``, below 1e-8 m, on the tip.
        near: homing starts below ``near * ell_m`` of error.
        home_steps: maximum number of homing steps.
        contraction: where homing steps shrink less than by this factor, their metric gets the task's
        curvature. slow: a damped step that leaves more than this share of the error ends the approach.
        iterations: maximum number of damped steps per start. settling: maximum number of Newton steps per
        start, for targets that are not met. starts: starts after the seed for a target that is not met.
        agreeing: number of starts ending at the best answer that ends the search for a target beyond the
            length of the arm; within its length every start is tried.
        tracking: a descent from the seed that moves less than ``tracking * ell_m`` without meeting its target
            follows a bounded optimum from tick to tick: then at most ``agreeing`` starts, to stay in time.
    """

    ell_m: float
    tolerance_m: float = 1e-6
    home_tolerance_m: float = 1e-8
    weight: float = 1e-8
    near: float = 0.3
    home_steps: int = 30
    contraction: float = 0.3
    slow: float = 0.95
    iterations: int = 60
    settling: int = 80
    starts: int = 32
    agreeing: int = 3
    tracking: float = 0.1


def tuning_for(feasible: Feasible) -> Tuning:
    """Numbers scaled to the size of the robot: ``ell`` is a fifth of the arm in its home posture."""
    return Tuning(ell_m=0.2 * (float(feasible.home.sum()) / 3.0 + sum(feasible.sections.rigid_m)))


class Goal(NamedTuple):
    """Tip, and optionally its unit tangent or the mid-point, in the base frame [m]."""

    tip: Vec3
    direction: Vec3 | None = None
    mid: Vec3 | None = None


class Descent:
    """Descent from one start; the native twin makes the same decisions in the same order."""

    def __init__(self, feasible: Feasible, tuning: Tuning) -> None:
        self.feasible = feasible
        self.sections = feasible.sections
        self.tuning = tuning

    def error(self, lengths: Array, goal: Goal) -> float:
        """Norm of the task error [m]."""
        return float(np.linalg.norm(self._task(lengths, goal)[0]))

    def run(self, lengths: Array, goal: Goal) -> tuple[Array, float, int]:
        """One start: lengths [m], shape ``(3 n,)``, error [m] and steps taken."""
        homes = self.tuning.home_steps
        lengths, error, steps = self._approach(lengths, goal, homes)
        if error > self.tuning.tolerance_m:
            lengths, error, more = self._approach(lengths, goal, 0)
            steps += more
        if error > self.tuning.tolerance_m:
            lengths, error, more = self._settle(lengths, goal)
            steps += more
            if error <= self.tuning.tolerance_m:
                lengths, error, more = self._approach(lengths, goal, homes)
                steps += more
        return lengths, error, steps

    def _task(self, lengths: Array, goal: Goal) -> tuple[Array, Array]:
        """Error rows [m] and their Jacobian at ``lengths``."""
        at = differentiate(self.sections, lengths)
        errors, rows = [np.array(goal.tip) - at.frames.tip], [at.tip]
        if goal.direction is not None:
            tangent = at.frames.rotation[:, 2]
            errors.append(self.tuning.ell_m * (np.array(goal.direction) - tangent))
            rows.append(self.tuning.ell_m * np.cross(at.spin, tangent[:, None], axis=0))
        if goal.mid is not None:
            errors.append(np.array(goal.mid) - at.frames.mid)
            rows.append(at.mid)
        return np.concatenate(errors), np.vstack(rows)

    def _approach(self, lengths: Array, goal: Goal, homes_left: int) -> tuple[Array, float, int]:
        """Damped steps and homing, until the target is met or progress ends; returns the best lengths.

        Homing can raise the error for some steps, and along limits it may not settle.
        """
        t = self.tuning
        e, J = self._task(lengths, goal)
        error = float(np.linalg.norm(e))
        boost, reach = 1.0, t.ell_m
        best, least = lengths, error
        metric = self.feasible.metric
        last_step = float("inf")
        for iteration in range(1, t.iterations + 1):
            homing = homes_left > 0 and error < t.near * t.ell_m
            if homing:
                homes_left -= 1
                damping = t.weight
                z = self.feasible.home - lengths
                z = self.feasible.metric @ (z * min(1.0, reach / max(float(np.linalg.norm(z)), 1e-300)))
            else:
                damping = t.weight + boost * error * error / (2.0 * t.ell_m * t.ell_m)
                z = np.zeros(len(lengths))
            d, y = damped_step(J, e, damping, z, lengths, self.feasible, metric if homing else None)
            trial = self.feasible.pulled(lengths + d)
            step = float(np.abs(trial - lengths).max())
            e_trial, J_trial = self._task(trial, goal)
            trial_error = float(np.linalg.norm(e_trial))
            if homing and trial_error >= t.near * t.ell_m:
                reach *= 0.25
                continue
            if not homing and trial_error >= error and error > t.tolerance_m:
                if step < 1e-9:
                    return best, least, iteration
                boost *= 4.0
                continue
            slow = trial_error > t.slow * error
            lengths, e, J, error = trial, e_trial, J_trial, trial_error
            if error < least or error <= t.tolerance_m:
                best, least = lengths, error
            if homing and step > t.contraction * last_step:
                metric = self._home_metric(lengths, goal, y)
            last_step = step if homing else float("inf")
            if not homing:
                boost = max(0.25 * boost, 1e-6)
            if error <= t.tolerance_m and (not homing or step <= t.home_tolerance_m):
                return lengths, error, iteration
            if not homing and slow and error > t.tolerance_m:
                return best, least, iteration
        return best, least, t.iterations

    def _home_metric(self, lengths: Array, goal: Goal, y: Array) -> Array:
        """Second derivatives of ``|l - home|^2/2 - y^T task``, shifted until they are positive definite.

        The metric of home alone ignores the curvature of the set of lengths that meet the task; where its
        radius is as small as the distance from home, such steps do not converge.
        """
        size = len(lengths)
        base = self._task(lengths, goal)[1].T @ y
        metric = self.feasible.metric.copy()
        for k in range(size):
            moved = lengths.copy()
            moved[k] += _FORWARD_M
            metric[k] -= (self._task(moved, goal)[1].T @ y - base) / _FORWARD_M
        metric = 0.5 * (metric + metric.T)
        _, shift = _shifted_factor(metric, 0.0, least=0.5)
        return metric + shift * np.eye(size)

    def _settle(self, lengths: Array, goal: Goal) -> tuple[Array, float, int]:
        """Newton's method on ``|e|^2/2`` for a target that is not met, to the minimum on the limits.

        With a large residual the curvature left out by J^T J matters: Gauss-Newton would converge linearly.
        """
        e, J = self._task(lengths, goal)
        error = float(np.linalg.norm(e))
        shift = 0.0
        for iteration in range(1, self.tuning.settling + 1):
            push = J.T @ e
            H = self._hessian(lengths, goal)
            factor, shift = _shifted_factor(self._stiffened(H, lengths, push), shift)
            d = np.linalg.solve(factor.T, np.linalg.solve(factor, push))
            trial = self.feasible.pulled(lengths + bounded_step(factor, d, lengths, self.feasible))
            step = float(np.abs(trial - lengths).max())
            e_trial, J_trial = self._task(trial, goal)
            trial_error = float(np.linalg.norm(e_trial))
            if trial_error >= error:
                if step < 1e-8:
                    return lengths, error, iteration
                shift = max(4.0 * shift, _MIN_SHIFT)
                continue
            lengths, e, J, error = trial, e_trial, J_trial, trial_error
            if error <= self.tuning.tolerance_m or step < 1e-9:
                return lengths, error, iteration
            shift = 0.25 * shift if shift > _MIN_SHIFT else 0.0
        return lengths, error, self.tuning.settling

    def _hessian(self, lengths: Array, goal: Goal) -> Array:
        """Second derivatives of ``|e|^2/2``, from central differences of its gradient ``-J^T e``."""
        size = len(lengths)
        H = np.empty((size, size))
        for k in range(size):
            shift = np.zeros(size)
            shift[k] = _DIFFERENCE_M
            e_up, J_up = self._task(lengths + shift, goal)
            e_down, J_down = self._task(lengths - shift, goal)
            H[k] = (J_down.T @ e_down - J_up.T @ e_up) / (2.0 * _DIFFERENCE_M)
        return 0.5 * (H + H.T)

    def _stiffened(self, H: Array, lengths: Array, push: Array) -> Array:
        """H made stiff across limits that bind and are pushed against.

        A Hessian that is indefinite only across such a limit then needs no shift.
        """
        weight = 10.0 * float(np.abs(np.diag(H)).max())
        for number in np.flatnonzero(self.feasible.excess(lengths) > -BINDING_M):
            normal = self.feasible.normal(lengths, int(number))
            if normal @ push > 0.0:
                H = H + weight / float(normal @ normal) * np.outer(normal, normal)
        return H


def _shifted_factor(H: Array, shift: float, least: float = _MIN_SHIFT) -> tuple[Array, float]:
    """Lower Cholesky factor of ``H + shift``, the shift raised until there is one, and the shift."""
    while True:
        try:
            factor = cholesky(H + (shift + 1e-12) * np.eye(len(H)))
        except np.linalg.LinAlgError:
            shift = max(4.0 * shift, least)
            if shift > _MAX_SHIFT:
                raise
        else:
            return factor, shift
