"""Descent of the task error along the branch: every step ends in a stable equilibrium near the one before.

Slower than `solve`, which balances the moments on the way and may end in any equilibrium. Specification of
``contid/kernels/cosserat/descent.hpp``.
"""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.box_step import box_step
from contid.kinematics.cosserat.branch import equilibrium, settle
from contid.kinematics.cosserat.equilibrium import STATICS_TOLERANCE, Equilibrium
from contid.kinematics.cosserat.solve import TRUST_START, Problem, RodSolution
from contid.kinematics.cosserat.statics import Sweep
from contid.kinematics.cosserat.task import jacobian, residual

#: Part of a rejected step to which steps are limited, and the least limit [bar].
SHRINK = 0.25
NO_TRUST = 1e-7
#: A predicted reduction of the squared error that no longer matters, as a part of it.
NO_GAIN = 1e-12


def descend(
    problem: Problem, pressures: Array, base_moment: Array, at: Sweep, iterations: int, from_rest: bool
) -> RodSolution:
    """Descend from a stable equilibrium.

    Args:
        problem: what to solve.
        pressures: of the equilibrium [bar], inside the limits.
        base_moment: of the equilibrium [N·mm].
        at: its sweep, with derivatives.
        iterations: steps at most.
        from_rest: reach every equilibrium from rest by `branch.equilibrium` instead of from the one before:
            slower, and on the branch that counts also beyond its folds.
    """
    limits, tolerance = problem.limits, problem.tolerance
    p, moment, found = np.array(pressures, float), np.array(base_moment, float), at
    r = residual(problem.task, found)
    cost, trust, used = float(r @ r), TRUST_START, 0
    optimal = blocked = False
    while cost > tolerance**2 and used < iterations:
        used += 1
        assert found.tangents is not None
        both = jacobian(problem.task, found)
        try:
            G = np.linalg.solve(found.tangents.moment[:, :3], found.tangents.moment[:, 3:])
        except np.linalg.LinAlgError:
            break
        J = both[:, 3:] - both[:, :3] @ G
        H = J.T @ J
        H[np.diag_indices(len(p))] += 1e-13 * float(np.trace(H))
        g = J.T @ r
        step = box_step(H, g, np.maximum(limits.lower - p, -trust), np.minimum(limits.upper - p, trust))
        size = float(np.abs(step).max())
        gain = -float(step @ (2.0 * g + H @ step))
        if gain <= NO_GAIN * cost:
            optimal = not blocked
            break
        following = np.clip(p + step, limits.lower, limits.upper)
        trial: Equilibrium | None
        if from_rest:
            reached = equilibrium(problem.rod, following, problem.loads, problem.elements)
            trial = Equilibrium(reached.base_moment, reached.sweep, True) if reached.done == 1.0 else None
        else:
            trial = settle(
                problem.rod, following, moment - G @ step, problem.loads, problem.elements, STATICS_TOLERANCE
            )
        new_r = r if trial is None else residual(problem.task, trial.sweep)
        new_cost = float(new_r @ new_r)
        if trial is not None and new_cost < cost:
            if cost - new_cost > 0.75 * gain:
                trust = max(trust, 2.0 * size)
            if cost - new_cost < 0.25 * gain:
                trust = 0.5 * size
            p, moment, found, r, cost = following, trial.base_moment, trial.sweep, new_r, new_cost
            blocked = False
        else:
            trust = SHRINK * size
            blocked = blocked or trial is None
            if trust < NO_TRUST:
                optimal = not blocked
                break
    met = cost <= tolerance**2
    return RodSolution(
        p, moment, float(np.sqrt(cost)), float(np.linalg.norm(found.moment)), met, met or optimal, used,
        found, blocked and not met,
    )  # fmt: skip
