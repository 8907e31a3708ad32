"""Inverse statics: bounded least squares on the task, with equilibrium as a constraint (the specification).

Unknowns are the base moment and the pressures. The moment balance e(M, P) = 0 is linearised and eliminated,

    dM = -A^-1 (e + B dP),    r + J dP  with  J = D - C A^-1 B,

so an unreachable target never costs equilibrium (erratum: eqs. 13-17 put both in one sum). What is left is
a Gauss-Newton step on the task r inside the pressure limits and a trust box; where the task is redundant, a
small weight on the distance from a centre chooses among the answers near the start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.box_step import box_step
from contid.kinematics.cosserat.equilibrium import newton
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from contid.kinematics.cosserat.statics import Sweep, sweep
from contid.kinematics.cosserat.task import Task, jacobian, residual

#: Weight of the secondary goal [mm^2/bar^2]: small enough to displace a reachable tip by less than 1e-6 mm.
CENTRE_WEIGHT = 1e-6
#: Moment balance that counts as equilibrium inside a descent [N·mm]; it moves a tip by 1e-5 mm at most.
BALANCE_TOLERANCE = 1e-6
#: A step of pressure that no longer matters [bar].
STEP_TOLERANCE = 1e-9
#: A step in the null space of the task, below which the secondary goal counts as reached [bar].
FREEDOM_TOLERANCE = 1e-4
#: Task error a step towards the centre may cost for the moment [mm].
NULL_SPACE_ERROR = 0.3
#: First largest step of a pressure [bar].
TRUST_START = 0.5
#: What moves a start off the axis [bar].
OFF_AXIS = 1e-6


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds and centre of the pressures [bar], shape (3k,) each."""

    lower: Array
    upper: Array
    centre: Array

    def off_axis(self, pressures: Array) -> Array:
        """Pressures [bar], shape (3k,), that are not equal in every section.

        From equal ones a search for a tip on the axis would stay there until rounding chooses one of the
        mirrored solutions; so every processor chooses the same.
        """
        if np.any(np.ptp(pressures.reshape(-1, 3), axis=1) >= OFF_AXIS):
            return pressures
        moved = pressures.copy()
        step = OFF_AXIS * np.array([1.0, 2.0])
        moved[:2] += np.where(pressures[:2] + step <= self.upper[:2], step, -step)
        return moved


@dataclass(frozen=True, slots=True)
class Problem:
    """One inverse problem.

    Attributes:
        rod, loads, task, limits: the rod, its loads, the target, the bounds of the pressures.
        elements: steps per section.
        tolerance: task error that counts as met [mm].
    """

    rod: Rod
    loads: Loads
    task: Task
    limits: Limits
    elements: int = 3
    tolerance: float = 1e-5


@dataclass(frozen=True, slots=True)
class RodSolution:
    """Where the solver ended.

    Attributes:
        pressures: [bar], always inside the limits.
        base_moment: [N·mm].
        residual: norm of the task error [mm], directions scaled by the task's length.
        statics: norm of the moment balance at the tip [N·mm].
        met: True when task and equilibrium are met.
        optimal: True when no feasible direction reduces the task error further (always when met).
        iterations: sweeps with derivatives.
        sweep: the last integration.
        blocked: True when the last steps led out of the stable equilibria (`descent`).
    """

    pressures: Array
    base_moment: Array
    residual: float
    statics: float
    met: bool
    optimal: bool
    iterations: int
    sweep: Sweep
    blocked: bool = False


def solve(problem: Problem, start: Array, start_moment: Array, iterations: int = 60) -> RodSolution:
    """One descent from one start.

    Args:
        problem: what to solve.
        start: pressures to start from [bar]; clamped into the limits.
        start_moment: base moment to start from [N·mm].
        iterations: sweeps with derivatives at most.
    """
    rod, loads, task, limits = problem.rod, problem.loads, problem.task, problem.limits
    elements, tolerance = problem.elements, problem.tolerance
    n = rod.pressures
    weight = CENTRE_WEIGHT if task.rows < n else 0.0
    # How far a base moment moves the tip, to weigh moments against millimetres.
    first = rod.sections[0]
    balance = (rod.reach**2 * 0.5 * first.inflated(np.zeros(3)).bend) ** 2
    pressures = np.clip(np.array(start, float), limits.lower, limits.upper)
    if weight:
        pressures = limits.off_axis(pressures)
    moment = np.array(start_moment, float)

    def measures(r: Array, e: Array, p: Array) -> tuple[float, float]:
        away = p - limits.centre
        return float(r @ r + balance * (e @ e)), weight * float(away @ away)

    found = sweep(rod, pressures, moment, loads, elements, tangents=True)
    r = residual(task, found)
    cost, away = measures(r, found.moment, pressures)
    trust, damping = TRUST_START, 1.0
    optimal = False
    used = 0
    while used < iterations:
        used += 1
        assert found.tangents is not None
        both = jacobian(task, found)
        A, B = found.tangents.moment[:, :3], found.tangents.moment[:, 3:]
        try:
            G = np.linalg.solve(A, np.column_stack([B, found.moment]))
        except np.linalg.LinAlgError:
            break
        J = both[:, 3:] - both[:, :3] @ G[:, :-1]
        ahead = r - damping * both[:, :3] @ G[:, -1]
        H = J.T @ J
        H[np.diag_indices(n)] += weight + 1e-13 * float(np.trace(H))
        # The secondary goal converges linearly where the task is strongly curved: only in the first half.
        pull = weight if used <= iterations // 2 else 0.0
        g = J.T @ ahead + pull * (pressures - limits.centre)
        step = box_step(
            H, g, np.maximum(limits.lower - pressures, -trust), np.minimum(limits.upper - pressures, trust)
        )
        size = float(np.abs(step).max())
        balanced = float(np.linalg.norm(found.moment)) <= BALANCE_TOLERANCE
        good = float(np.linalg.norm(r)) <= tolerance
        # A small step ends the descent only where it no longer helps; near a target it still does.
        stuck = size <= STEP_TOLERANCE and float(np.linalg.norm(ahead + J @ step)) > 0.5 * float(
            np.linalg.norm(r)
        )
        if balanced and (stuck or (good and (not pull or size <= FREEDOM_TOLERANCE))):
            optimal = True
            break
        new_pressures = np.clip(pressures + step, limits.lower, limits.upper)
        new_moment = moment - damping * G[:, -1] - G[:, :-1] @ step
        trial = sweep(rod, new_pressures, new_moment, loads, elements, tangents=True)
        new_r = residual(task, trial)
        new_cost, new_away = measures(new_r, trial.moment, new_pressures)
        # In the null space of the task a straight step costs task error, which the next one removes.
        sideways = pull > 0.0 and new_cost <= NULL_SPACE_ERROR**2 and new_away < away
        better = new_cost + new_away < cost + away or (pull < weight and new_cost < cost)
        if better or sideways or (size < 1e-6 and new_cost < cost + 1e-14):
            pressures, moment, found, r = new_pressures, new_moment, trial, new_r
            if sideways or new_cost < 0.5 * cost:
                trust *= 2.0
            cost, away, damping = new_cost, new_away, min(1.0, 2.0 * damping)
        else:
            trust, damping = 0.3 * min(trust, max(size, 1e-12)), 0.5 * damping
            if trust < 1e-12:
                break
    met = float(np.linalg.norm(r)) <= tolerance and float(np.linalg.norm(found.moment)) <= BALANCE_TOLERANCE
    if not met:
        # Out of reach or not converged: the answer is still an equilibrium to rounding.
        settled = newton(rod, pressures, moment, loads, elements)
        moment, found = settled.base_moment, settled.sweep
        r = residual(task, found)
    error, statics = float(np.linalg.norm(r)), float(np.linalg.norm(found.moment))
    met = error <= tolerance and statics <= BALANCE_TOLERANCE
    return RodSolution(pressures, moment, error, statics, met, met or optimal, used, found)
