"""Of all pressures that meet a redundant task the nearest to the centre.

    minimise  1/2 |P - centre|^2   subject to   r(P) = 0,  P inside its limits

Every iterate meets the task: a step minimises a quadratic model with the linearised task as an equation,
chords bring it back onto the target. The metric is the identity at first; where steps do not shrink it
becomes the second derivative of the Lagrangian, with the task's curvature. Long steps must lower the
distance; short ones must lower it by more than rounding, or be shorter than the one before, because the
derivatives of a sweep are those of the rod, not of its elements. An answer solved again from itself does
not move: its step is below `SETTLED`.
Specification of ``contid/kernels/cosserat/home.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.box_step import box_step
from contid.kinematics.cosserat.solve import CENTRE_WEIGHT, TRUST_START, Problem, RodSolution
from contid.kinematics.cosserat.statics import Sweep, sweep
from contid.kinematics.cosserat.task import jacobian, residual

#: Steps, chords of a step, and shifts of a metric that is not positive definite, at most.
STEPS, CHORDS, SHIFTS = 100, 16, 16
#: A step of pressure at which an answer is settled [bar].
SETTLED = 1e-7
#: Task error [mm] and moment balance [N·mm] of an iterate.
EXACT_TASK, EXACT_BALANCE = 1e-8, 1e-8
#: Steps too short for a comparison of distances [bar]; a longer one must make this share of its gain.
NOISE, GAIN = 3e-3, 1e-4
#: A step longer than this share of the one before calls for the curvature; a short one has to be shorter than
#: that share of the one before.
CONTRACTION, SHRINKING = 0.3, 0.8
#: Gain of a short step that is more than rounding, half of a squared distance [bar^2].
LEAST_GAIN = 1e-9
#: Forward differences of the derivatives [bar].
FORWARD = 1e-4
SHRINK = 0.25


@dataclass(frozen=True, slots=True)
class _Iterate:
    """Pressures [bar] and base moment [N·mm] with their sweep, task error and its derivatives.

    ``J`` is the derivative with the balance eliminated, ``inverse`` that of the balance by the moment, ``G``
    the moment by the pressures, ``C`` the task by the moment.
    """

    p: Array
    moment: Array
    found: Sweep
    r: Array
    J: Array
    inverse: Array
    G: Array
    C: Array

    def ahead(self, r: Array, e: Array) -> Array:
        """The task error once the balance is restored."""
        left: Array = r - self.C @ (self.inverse @ e)
        return left


def home(problem: Problem, outcome: RodSolution) -> RodSolution:
    """The outcome, which meets its task, settled."""
    limits, n = problem.limits, problem.rod.pressures
    here = _at(problem, limits.off_axis(outcome.pressures), outcome.base_moment)
    if here is None:
        return outcome
    y = np.zeros(len(here.r))
    metric = np.eye(n)
    trust, last = TRUST_START, np.inf
    curved = fresh = left = False
    used = 0
    while used < STEPS:
        used += 1
        weighed = here.J.T @ here.J
        weighed[np.diag_indices(n)] += 1e-13 * float(np.trace(weighed))
        low, high = np.maximum(limits.lower - here.p, -trust), np.minimum(limits.upper - here.p, trust)
        ahead = here.ahead(here.r, here.found.moment)
        # The weight leaves a part of the error that the multipliers found so far remove.
        for _ in range(2):
            g = CENTRE_WEIGHT * (here.p - limits.centre) + here.J.T @ (ahead + CENTRE_WEIGHT * y)
            d = box_step(weighed + CENTRE_WEIGHT * metric, g, low, high)
            y = y + (ahead + here.J @ d) / CENTRE_WEIGHT
        size = float(np.abs(d).max())
        if size <= SETTLED:
            break
        there = _onto(problem, here, d)
        good = there is not None
        if there is not None and _exact(here.r, here.found):
            gain = abs(float(d @ (here.p - limits.centre + 0.5 * d)))
            nearer = _distance(problem, here.p) - _distance(problem, there[0])
            good = nearer >= GAIN * gain if size > NOISE else size < SHRINKING * last or nearer > LEAST_GAIN
        if good and there is not None:
            bend = curved or size > CONTRACTION * last
            trust = max(trust, 2.0 * size)
            last = np.inf if bend and not curved else size
            following = _at(problem, *there)
            if following is None:
                break
            here, left = following, True
            metric = _metric(problem, here, y) if bend else np.eye(n)
            curved = fresh = bend
        elif not fresh:
            metric, curved, fresh, last = _metric(problem, here, y), True, True, np.inf
        elif size > NOISE:
            trust = SHRINK * size
        else:
            break
    used += outcome.iterations
    if not left:
        return replace(outcome, iterations=used)
    error, statics = float(np.linalg.norm(here.r)), float(np.linalg.norm(here.found.moment))
    return RodSolution(here.p, here.moment, error, statics, True, True, used, here.found)


def _distance(problem: Problem, pressures: Array) -> float:
    away = pressures - problem.limits.centre
    return 0.5 * float(away @ away)


def _exact(r: Array, found: Sweep) -> bool:
    return float(np.linalg.norm(r)) <= EXACT_TASK and float(np.linalg.norm(found.moment)) <= EXACT_BALANCE


def _at(problem: Problem, pressures: Array, base_moment: Array) -> _Iterate | None:
    """A point with its derivatives; None at a critical load."""
    found = sweep(problem.rod, pressures, base_moment, problem.loads, problem.elements, tangents=True)
    assert found.tangents is not None
    both = jacobian(problem.task, found)
    try:
        inverse = np.asarray(np.linalg.inv(found.tangents.moment[:, :3]), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    G = inverse @ found.tangents.moment[:, 3:]
    C = both[:, :3]
    return _Iterate(
        pressures, base_moment, found, residual(problem.task, found), both[:, 3:] - C @ G, inverse, G, C
    )


def _onto(problem: Problem, here: _Iterate, d: Array) -> tuple[Array, Array] | None:
    """Pressures and base moment on the target after a step; None where chords do not get there.

    Axes that the step brings to a limit stay there while enough others are free.
    """
    limits, n = problem.limits, len(d)
    held = (here.p + d <= limits.lower) | (here.p + d >= limits.upper)
    stays = held if int((~held).sum()) >= problem.task.rows else np.zeros(n, dtype=bool)
    H = here.J.T @ here.J
    H[np.diag_indices(n)] += CENTRE_WEIGHT + 1e-13 * float(np.trace(H))
    p, moment, e, step, before = here.p, here.moment, here.found.moment, d, np.inf
    for _ in range(CHORDS + 1):
        p = np.clip(p + step, limits.lower, limits.upper)
        moment = moment - here.inverse @ e - here.G @ step
        found = sweep(problem.rod, p, moment, problem.loads, problem.elements)
        r, e = residual(problem.task, found), found.moment
        if _exact(r, found):
            return p, moment
        error = float(np.linalg.norm(r)) + float(np.linalg.norm(e))
        if not error < 0.5 * before:
            return None
        before = error
        step = box_step(
            H,
            here.J.T @ here.ahead(r, e),
            np.where(stays, 0.0, limits.lower - p),
            np.where(stays, 0.0, limits.upper - p),
        )
    return None


def _metric(problem: Problem, at: _Iterate, y: Array) -> Array:
    """``1 + sum_a y_a d2 r_a / dP2`` by differences, shifted until positive where the task is free.

    Shape ``(n, n)``. Axes at a limit do not count.
    """
    limits, n = problem.limits, len(at.p)
    curvature = np.zeros((n, n))
    base = at.J.T @ y
    for k in range(n):
        d = np.zeros(n)
        d[k] = FORWARD if at.p[k] + FORWARD <= limits.upper[k] else -FORWARD
        moved = _at(problem, at.p + d, at.moment - at.inverse @ at.found.moment - at.G @ d)
        curvature[k] = 0.0 if moved is None else (moved.J.T @ y - base) / d[k]
    free = np.flatnonzero((at.p > limits.lower) & (at.p < limits.upper))
    task = (at.J.T @ at.J)[np.ix_(free, free)]
    metric = np.eye(n) + 0.5 * (curvature + curvature.T)
    shift = 0.0
    for _ in range(SHIFTS + 1):
        shifted: Array = metric + shift * np.eye(n)
        least = 0.01 * CENTRE_WEIGHT * np.eye(len(free))
        try:
            np.linalg.cholesky(task + CENTRE_WEIGHT * shifted[np.ix_(free, free)] - least)
        except np.linalg.LinAlgError:
            shift = 0.02 if shift == 0.0 else 2.0 * shift
        else:
            break
    return shifted
