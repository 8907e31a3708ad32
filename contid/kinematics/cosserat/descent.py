"""Descent of the task error along the branch: every step ends in a stable equilibrium near the one before.

Slower than `solve`, which balances the moments on the way and may end in any equilibrium. Specification of
``contid/kernels/cosserat/descent.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.cosserat.box_step import box_step
from contid.kinematics.cosserat.branch import settle
from contid.kinematics.cosserat.equilibrium import STATICS_TOLERANCE
from contid.kinematics.cosserat.ramp import BranchPose, way_to
from contid.kinematics.cosserat.solve import TRUST_START, Problem, RodSolution
from contid.kinematics.cosserat.task import jacobian, residual

#: Part of a rejected step to which steps are limited, and the least limit [bar].
SHRINK = 0.25
NO_TRUST = 1e-7
#: A predicted reduction of the squared error that no longer matters, as a part of it.
NO_GAIN = 1e-12
#: Steps whose gain together decides whether a descent goes on.
RECENT = 3
#: Cost of following a path from rest, in steps of a descent.
RAMP_WORK = 3


@dataclass(frozen=True, slots=True)
class StopRule:
    """When a descent ends.

    Attributes:
        work: steps at most, each path followed from rest counted as `RAMP_WORK`.
        gain: of the last `RECENT` steps together, the least, as a part of the error.
        best: error of another outcome [mm].
        ahead: ends where this multiple of that gain does not reach ``best``; 0 for never.
        trust: the least limit of a step [bar].
    """

    work: int
    gain: float = 0.0
    best: float = 0.0
    ahead: float = 0.0
    trust: float = NO_TRUST


def descend(problem: Problem, start: BranchPose, stop: StopRule) -> RodSolution:
    """From one pose on the branch to others, each near the one before; ``start`` is inside the limits."""
    limits, tolerance = problem.limits, problem.tolerance
    here, found = start, start.sweep
    r = residual(problem.task, found)
    cost, trust, used, step_count = float(r @ r), TRUST_START, 0, 0
    recent = [0.0] * RECENT
    optimal = blocked = False
    while cost > tolerance**2 and used < stop.work:
        used += 1
        error = float(np.sqrt(cost))
        if step_count >= RECENT:
            gained = recent[step_count % RECENT] - error
            hopeless = stop.ahead > 0.0 and error - stop.best > stop.ahead * gained
            if gained < stop.gain * error or hopeless:
                break
        recent[step_count % RECENT] = error
        step_count += 1
        p = here.pressures
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
        trial = settle(
            problem.rod,
            following,
            here.base_moment - G @ step,
            problem.loads,
            problem.elements,
            STATICS_TOLERANCE,
        )
        new_r = r if trial is None else residual(problem.task, trial.sweep)
        new_cost = float(new_r @ new_r)
        if trial is not None and new_cost < cost:
            ramp, followed = way_to(problem, following, trial.base_moment, here)
            used += RAMP_WORK if followed else 0
            if ramp is None:
                trial = None
            else:
                pose = BranchPose(following, trial.base_moment, trial.sweep, ramp)
        if trial is not None and new_cost < cost:
            if cost - new_cost > 0.75 * gain:
                trust = max(trust, 2.0 * size)
            if cost - new_cost < 0.25 * gain:
                trust = 0.5 * size
            here, found, r, cost = pose, trial.sweep, new_r, new_cost
            blocked = False
        else:
            trust = SHRINK * size
            blocked = blocked or trial is None
            if trust < stop.trust:
                optimal = not blocked and trust < NO_TRUST
                break
    met = cost <= tolerance**2
    return RodSolution(
        here.pressures, here.base_moment, float(np.sqrt(cost)), float(np.linalg.norm(found.moment)), met,
        met or optimal, used, found, blocked and not met,
    )  # fmt: skip


def outcome_of(problem: Problem, pose: BranchPose) -> RodSolution:
    """An outcome that is a pose on the branch."""
    left = float(np.linalg.norm(residual(problem.task, pose.sweep)))
    statics = float(np.linalg.norm(pose.sweep.moment))
    met = left <= problem.tolerance
    return RodSolution(pose.pressures, pose.base_moment, left, statics, met, met, 0, pose.sweep, not met)
