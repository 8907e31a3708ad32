"""One descent of the bounded inverse kinematics: damped steps, homing, and Newton out of reach.

A step solves a quadratic programme over the limits (`active_set`), never clips:

* far from the target:   min |J d - e|^2 + (w + mu |e|^2 / (2 ell^2)) |d|^2        (Sugihara's damping)
* near the target:       `home`
* not met:               min 1/2 d^T H d - (J^T e)^T d,  H the second derivative of |e|^2/2

The damping is scaled by the length ``ell``, a fifth of the arm: with errors in mm against singular values
near 1 the literature's ``lambda^2 = |e|^2/2`` stalls. Specification of ``descent.hpp`` and ``newton.hpp``.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from contid.kinematics.arc.active_set import bounded_step, cholesky, damped_step
from contid.kinematics.arc.avoid import Avoid
from contid.kinematics.arc.feasible import BINDING_M, BoundedChain
from contid.kinematics.arc.home import Homing
from contid.kinematics.arc.task import Goal, Tuning, task
from contid.kinematics.array import Array

# Central differences of the gradient [m]: 1e-10 of truncation, 1e-11 of rounding.
_DIFFERENCE_M: Final = 1e-5
# A shift that makes any Hessian of an arm positive definite.
_MAX_SHIFT: Final = 1e12
_MIN_SHIFT: Final = 1e-3


class Descent:
    """Descent from one start; the native twin makes the same decisions in the same order."""

    def __init__(self, feasible: BoundedChain, tuning: Tuning) -> None:
        self.feasible = feasible
        self.sections = feasible.sections
        self.tuning = tuning
        self._homing = Homing(feasible, tuning)

    def error(self, lengths: Array, goal: Goal) -> float:
        """Norm of the task error [m]."""
        return float(np.linalg.norm(self._task(lengths, goal)[0]))

    def run(
        self, lengths: Array, goal: Goal, avoid: Avoid | None = None, settling: int | None = None
    ) -> tuple[Array, float, int]:
        """One start: lengths [m], shape ``(3 n,)``, error [m] and steps taken.

        Args:
            lengths: to start from [m].
            goal: of the task.
            avoid: obstacles.
            settling: Newton steps where it is not met, instead of those of the tuning.
        """
        t = self.tuning
        lengths, error, steps = self._approach(lengths, goal, t.near * t.ell_m)
        if error < t.near * t.ell_m:
            settled, left, more = self._home(lengths, goal, error, avoid)
            steps += more
            if left <= t.tolerance_m:
                return settled, left, steps
        lengths, error, more = self._approach(lengths, goal, t.tolerance_m)
        steps += more
        if error > t.tolerance_m:
            lengths, error, more = self._settle(lengths, goal, t.settling if settling is None else settling)
            steps += more
        if error <= t.tolerance_m:
            settled, left, more = self._home(lengths, goal, error, avoid)
            steps += more
            if left <= t.tolerance_m:
                return settled, left, steps
        return lengths, error, steps

    def _home(
        self, lengths: Array, goal: Goal, error: float, avoid: Avoid | None
    ) -> tuple[Array, float, int]:
        """The settled lengths, the error left [m] and steps taken."""
        if self.tuning.home_steps == 0:
            return lengths, error, 0
        t = self.tuning
        settled, left, steps = self._homing.run(lengths, goal, avoid)
        # Where homing ended on its steps or its merit, the target can be met better than its tolerance.
        if t.still_error_m < left <= t.tolerance_m:
            settled, left, more = self._approach(settled, goal, t.still_error_m)
            steps += more
        return settled, left, steps

    def _task(self, lengths: Array, goal: Goal) -> tuple[Array, Array]:
        return task(self.sections, self.tuning.ell_m, lengths, goal)

    def _approach(self, lengths: Array, goal: Goal, enough_m: float) -> tuple[Array, float, int]:
        """Damped steps until the error is ``enough_m`` or progress ends."""
        t = self.tuning
        e, J = self._task(lengths, goal)
        error = float(np.linalg.norm(e))
        boost = 1.0
        iteration = 0
        while iteration < t.iterations and error > enough_m:
            iteration += 1
            damping = t.weight + boost * error * error / (2.0 * t.ell_m * t.ell_m)
            d = damped_step(J, e, damping, lengths, self.feasible)
            trial = self.feasible.pulled(lengths + d)
            step = float(np.abs(trial - lengths).max())
            e_trial, J_trial = self._task(trial, goal)
            trial_error = float(np.linalg.norm(e_trial))
            if trial_error >= error:
                if step < 1e-9:
                    break
                boost *= 4.0
                continue
            slow = trial_error > t.slow * error
            lengths, e, J, error = trial, e_trial, J_trial, trial_error
            boost = max(0.25 * boost, 1e-6)
            if slow and error > enough_m:
                break
        return lengths, error, iteration

    def _settle(self, lengths: Array, goal: Goal, most: int) -> tuple[Array, float, int]:
        """Newton's method on ``|e|^2/2`` for a target that is not met, to the minimum on the limits.

        With a large residual the curvature left out by J^T J matters: Gauss-Newton would converge linearly.
        """
        e, J = self._task(lengths, goal)
        error = float(np.linalg.norm(e))
        shift = 0.0
        for iteration in range(1, most + 1):
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
        return lengths, error, most

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


def _shifted_factor(H: Array, shift: float) -> tuple[Array, float]:
    """Lower Cholesky factor of ``H + shift``, the shift raised until there is one, and the shift."""
    while True:
        try:
            factor = cholesky(H + (shift + 1e-12) * np.eye(len(H)))
        except np.linalg.LinAlgError:
            shift = max(4.0 * shift, _MIN_SHIFT)
            if shift > _MAX_SHIFT:
                raise
        else:
            return factor, shift
