"""Of all lengths that meet a target the ones nearest to home, by sequential quadratic programming.

    minimise  1/2 (l - home)^T M (l - home) + potential(l)   subject to   task(l) = target,  l feasible

Home are the middle lengths of the ranges. The potential is that of obstacles (`contid.kinematics.arc.avoid`),
0 where none are given. The limits of bend are cones in the lengths, all others are planes.

A step minimises a quadratic model with the linearised task as an equation. Its metric is M at first (with the
stiffness of the potential). Where steps stop shrinking it becomes the second derivative of the Lagrangian,
with the curvature of task and bend cones, and the cones become their tangent planes. Steps must lower the
merit ``distance + penalty |e|``, e being the error of the task (Nocedal and Wright, Numerical Optimization,
2nd edition, chapter 18). So homing ends at a minimum, and solving again from an answer returns that answer.
Specification of ``home.hpp``.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from contid.kinematics.arc.active_set import bounded_step, cholesky, damped_step, solve
from contid.kinematics.arc.avoid import Avoid
from contid.kinematics.arc.feasible import BINDING_M, BoundedChain, TangentLimits
from contid.kinematics.arc.objective import Objective
from contid.kinematics.arc.task import Goal, Tuning, task
from contid.kinematics.array import Array

# The target counts as out of reach when a step is predicted to leave more than this share of the error.
_HOPELESS: Final = 0.9
# Error below which an answer counts as settled [m].
_EXACT_M: Final = 1e-10
# Weight of the error in the merit, as a multiple of the norm of the task's multipliers.
_PENALTY: Final = 1.5
# Share of the predicted gain of merit that a step must reach.
_DECREASE: Final = 1e-4
# Steps below this are taken without the merit, whose differences would be rounding [m].
_NOISE_M: Final = 1e-7
# A step that does not lower the merit is cut to a quarter up to this many times.
_CUTS: Final = 6
# Step of the forward differences of J^T y, which need few digits [m].
_FORWARD_M: Final = 1e-6
# A shift that makes any Hessian of an arm positive definite.
_MAX_SHIFT: Final = 1e12


class _Point(NamedTuple):
    """Lengths ``(N,)`` [m], error rows ``(m,)`` [m], their Jacobian and norm [m]."""

    lengths: Array
    e: Array
    J: Array
    error: float


class _Step(NamedTuple):
    """A step d of the lengths [m] and what the quadratic model predicts for it.

    Multipliers y of the task and ``cones`` of the cones; slope, the negative gradient of distance and
    potential, ``M (home - l)`` without obstacles; ``left``, the error after the step [m].
    """

    d: Array
    y: Array
    cones: Array
    slope: Array
    left: float


class _Curved(NamedTuple):
    """Factor of a metric with the curvature of task and cones, and the weight of ``J^T J`` in it."""

    factor: Array
    stiffness: float


class Homing:
    """Moves lengths that are near a target towards home.

    The native twin makes the same decisions in the same order.
    """

    def __init__(self, feasible: BoundedChain, tuning: Tuning) -> None:
        self.feasible = feasible
        self.tuning = tuning
        self._plain = self._objective = Objective(feasible)

    def run(self, lengths: Array, goal: Goal, avoid: Avoid | None = None) -> tuple[Array, float, int]:
        """Lengths [m], error [m] (above the tolerance when the target is not met) and steps taken."""
        t = self.tuning
        self._objective = self._plain if avoid is None else Objective(self.feasible, avoid)
        here = self._at(lengths, goal)
        curved: _Curved | None = None
        fresh, last_step = False, float("inf")  # fresh: the metric has the curvature at these lengths
        most = t.home_steps if avoid is None else 2 * t.home_steps
        for k in range(1, most + 1):
            model = self._step(here, goal, curved)
            # The step that the linear model predicts must close most of the error: else it is not met here.
            if here.error > t.tolerance_m and model.left > _HOPELESS * here.error:
                return here.lengths, here.error, k
            trial = self.feasible.pulled(here.lengths + model.d)
            still = _largest(trial - here.lengths) <= t.still_m
            if k == 1 and here.error <= t.still_error_m and still:
                return here.lengths, here.error, k
            solvable = model.left <= _EXACT_M or model.left <= 0.1 * here.error
            there = self._at(trial, goal)
            if _largest(trial - here.lengths) > _NOISE_M and not self._lower(here, model, there, 1.0):
                corrected = self._corrected(here, there, goal)
                if self._lower(here, model, corrected, 1.0):
                    there = corrected
                elif not fresh and solvable:
                    curved, fresh = self._curvature(here, goal, model), True
                    continue
                else:
                    shorter = self._shortened(here, goal, model)
                    if shorter is None and curved is None:
                        return here.lengths, here.error, k
                    if shorter is None:
                        curved = None  # the cones themselves instead of their tangent planes
                        continue
                    there = shorter
            step, before, here = _largest(there.lengths - here.lengths), here.error, there
            if step <= t.home_tolerance_m and (here.error <= _EXACT_M or here.error > 0.5 * before):
                return here.lengths, here.error, k
            # Multipliers of a task that the limits keep from being met have no meaning.
            fresh = solvable and step > t.contraction * last_step
            if fresh:
                curved = self._curvature(
                    here, goal, model._replace(slope=self._objective.slope(here.lengths))
                )
            elif not solvable:
                curved = None
            last_step = step
        return here.lengths, here.error, most

    def _at(self, lengths: Array, goal: Goal) -> _Point:
        e, J = task(self.feasible.sections, self.tuning.ell_m, lengths, goal)
        return _Point(lengths, e, J, float(np.linalg.norm(e)))

    def _lower(self, here: _Point, model: _Step, there: _Point, share: float) -> bool:
        """Whether ``there`` lowers the merit enough for this share of the step of the model."""
        penalty = _PENALTY * float(np.linalg.norm(model.y))
        gain = float(model.slope @ model.d) + penalty * (here.error - model.left)
        merit = self._objective.value(here.lengths) + penalty * here.error
        return (
            self._objective.value(there.lengths) + penalty * there.error <= merit - _DECREASE * share * gain
        )

    def _corrected(self, here: _Point, at: _Point, goal: Goal) -> _Point:
        """The point ``at`` after a full step, moved back onto the target: the task is curved."""
        factor = self._objective.factor(here.lengths)
        back = damped_step(at.J, at.e, self.tuning.weight, at.lengths, self.feasible, factor)
        return self._at(self.feasible.pulled(at.lengths + back), goal)

    def _shortened(self, here: _Point, goal: Goal, model: _Step) -> _Point | None:
        share = 1.0
        for _ in range(_CUTS):
            share *= 0.25
            there = self._at(self.feasible.pulled(here.lengths + share * model.d), goal)
            if self._lower(here, model, there, share):
                return there
        return None

    def _step(self, here: _Point, goal: Goal, curved: _Curved | None) -> _Step:
        """Minimise ``1/2 d^T W d - z^T d`` with ``J d = e`` and l + d inside the limits.

        ``d = W^-1 (z + J^T y)`` with ``(J W^-1 J^T + w) y = e - J W^-1 z``. The weight w bounds y where the
        task is singular; the part of e that it leaves over is solved for once more.
        """
        weight, J = self.tuning.weight, here.J
        e = here.e.copy()
        sections = self.feasible.sections
        if sections.to_arc.shape[-1] == 2 and goal.mid is not None:
            _drop_normal(J, e, len(e) - 3)
        if sections.to_arc.shape[-1] == 2 and sections.count == 1:
            _drop_normal(J, e, 0)
        if goal.direction is not None:  # only what is across the tangent: no length changes the rest
            tangent = np.array(goal.direction) - e[3:6] / self.tuning.ell_m
            e[3:6] -= float(e[3:6] @ tangent) * tangent
        slope = self._objective.slope(here.lengths)
        z = slope if curved is None else slope + curved.stiffness * (J.T @ e)
        factor = self._objective.factor(here.lengths) if curved is None else curved.factor
        limits = self.feasible if curved is None else TangentLimits(self.feasible, here.lengths)
        K, base = solve(factor, J.T).T, solve(factor, z)
        gram = K @ K.T + weight * np.eye(len(e))
        asked = e - K @ base
        cones = np.zeros(self.feasible.sections.count)
        for _ in range(2):
            y = solve(gram, asked)
            y = y + solve(gram, weight * y)
            free = solve(factor.T, base + K.T @ y)
            cones[:] = 0.0
            d = bounded_step(factor, free, here.lengths, limits, K, weight, cones)
            held = J @ (free - d) / weight  # the limits' part of the multipliers
            y = y + held
            if not held.any():
                break
            asked = asked + weight * held
        return _Step(d, y, cones, slope, float(np.linalg.norm(e - J @ d)))

    def _curvature(self, at: _Point, goal: Goal, model: _Step) -> _Curved:
        """Factor of ``M + d2 potential/dl2 - sum_a y_a d2 task_a/dl2 + sum_s cones_s d2 cone_s/dl2``.

        Where it is not positive definite, ``J^T J`` is added first, which changes no step that keeps the
        task; then the limits that bind, and a multiple of M.
        """
        feasible, size = self.feasible, len(at.lengths)
        base, push, H = at.J.T @ model.y, self._objective.push(at.lengths), feasible.metric.copy()
        for k in range(size):
            moved = at.lengths.copy()
            moved[k] += _FORWARD_M
            H[k] -= (self._at(moved, goal).J.T @ model.y - base) / _FORWARD_M
            H[k] += (self._objective.push(moved) - push) / _FORWARD_M
        H = 0.5 * (H + H.T)
        for s, weight in enumerate(model.cones):
            if weight > 0.0:
                H += weight * feasible.cone_curvature(at.lengths, s)
        squared = at.J.T @ at.J
        stiffness, shift, attempt = 0.0, 0.0, 0
        while True:
            try:
                return _Curved(cholesky(H + shift * feasible.metric + stiffness * squared), stiffness)
            except np.linalg.LinAlgError:
                if shift > _MAX_SHIFT:
                    raise
            if attempt < 3:
                first = float(np.trace(feasible.metric) / np.trace(squared))
                stiffness = first if attempt == 0 else 10.0 * stiffness
            elif attempt == 3:
                H = self._held(H, at, model)
            else:
                shift = 0.01 if shift == 0.0 else 4.0 * shift
            attempt += 1

    def _held(self, H: Array, at: _Point, model: _Step) -> Array:
        """H made stiff across the limits that bind and are pushed against."""
        feasible = self.feasible
        push = model.slope + at.J.T @ model.y
        stiff = 10.0 * float(np.abs(np.diag(H)).max())
        flat = feasible.flat
        for number, excess in enumerate(feasible.excess(at.lengths)):
            normal = feasible.normal(at.lengths, number)
            if number >= flat:
                pushed = model.cones[number - flat] > 0.0
            else:
                pushed = excess > -BINDING_M and normal @ push > 0.0
            if pushed:
                H = H + stiff / float(normal @ normal) * np.outer(normal, normal)
        return H


def _drop_normal(J: Array, e: Array, row: int) -> None:
    """Drop errors across the surface on which the end of one section of given length stays, in place."""
    normal = np.cross(J[row : row + 3, 0], J[row : row + 3, 1])
    size = float(normal @ normal)
    if size > 0.0:
        e[row : row + 3] -= float(normal @ e[row : row + 3]) / size * normal


def _largest(change: Array) -> float:
    return float(np.abs(change).max())
