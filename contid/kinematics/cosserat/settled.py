"""Answers that stay when they are solved again from themselves.

A first answer far from its seed may end where a search from itself would go on: beside a saddle of the
distance to the centre, or where a descent along the branch took another way. It is solved again until it
stays, a few times at most. A thorough search goes on in the same way from a loaded answer out of reach, while
that gets nearer. Answers near their seed continue a motion, and every tick solves again anyway.
Specification of ``contid/kernels/cosserat/settled.hpp``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.along_branch.branch_search import Found
from contid.kinematics.cosserat.along_branch.effort import THOROUGH, Effort
from contid.kinematics.cosserat.along_branch.refine import TRACKING
from contid.kinematics.cosserat.along_branch.straight_path import NO_SNAP, at_target, snap_from
from contid.kinematics.cosserat.search import search
from contid.kinematics.cosserat.solve import Problem, RodSolution

#: Further searches at most, and the change of pressure below which an answer is settled [bar].
MOST_SEARCHES, SETTLED_BAR = 4, 1e-7


def search_settled(problem: Problem, seed: Array, error: float = np.inf, effort: Effort = THOROUGH) -> Found:
    """`search`, repeated from its own answer until that stays: for redundancy, or out of reach under load.

    Args:
        problem: what to solve, with the minimum number of elements.
        seed: the last commanded pressures [bar].
        error: estimated discretisation error [mm] at which the elements are doubled.
        effort: of a search on the branch; out of reach only the thorough one is repeated.
    """
    found = search(problem, seed, error, effort)
    redundant = problem.task.rows < problem.rod.pressures
    thorough = not problem.loads.is_zero and effort is THOROUGH
    for _ in range(MOST_SEARCHES):
        if not found.stable or _moved(found.outcome, seed) <= TRACKING:
            break
        if not (redundant if found.outcome.met else thorough):
            break
        again = search(problem, found.outcome.pressures, error, effort)
        spent = found.iterations + again.iterations
        found = replace(found, iterations=spent)
        if not _goes_on(found, again, error):
            break
        leaves = _snap(problem, seed, again)
        if leaves < NO_SNAP and _snap(problem, seed, found) == NO_SNAP:
            return found if found.outcome.met else replace(found, snap=min(found.snap, leaves))
        found = replace(again, iterations=spent, snap=again.snap if again.outcome.met else found.snap)
    return found


def _goes_on(found: Found, again: Found, error: float) -> bool:
    """True where the answer to a question asked again counts and is another one: nearer, or elsewhere."""
    if not again.stable:
        return False
    if found.outcome.met:
        return again.outcome.met and _moved(again.outcome, found.outcome.pressures) > SETTLED_BAR
    return again.outcome.residual < found.outcome.residual - error


def _moved(outcome: RodSolution, seed: Array) -> float:
    return float(np.abs(outcome.pressures - seed).max())


def _snap(problem: Problem, seed: Array, found: Found) -> float:
    """`snap_from` for an answer on the target, or next to it; `NO_SNAP` for others.

    Computed with the elements of that equilibrium: with fewer the same pressures hold another pose.
    """
    if problem.loads.is_zero or not at_target(found.outcome):
        return NO_SNAP
    return snap_from(replace(problem, elements=found.elements), seed, found.outcome)
