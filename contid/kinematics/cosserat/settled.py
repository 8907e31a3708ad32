"""Answers that stay when they are solved again from themselves.

A first answer far from its seed may end where a search from itself would go on: beside a saddle of the
distance to the centre, or where a descent along the branch took another way. It is solved again until it
stays, a few times at most. Answers near their seed continue a motion, and every tick solves again anyway.
Specification of ``contid/kernels/cosserat/settled.hpp``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.along_branch.branch_search import THOROUGH, Effort, Found
from contid.kinematics.cosserat.along_branch.refine import TRACKING
from contid.kinematics.cosserat.along_branch.straight_path import reached_from
from contid.kinematics.cosserat.search import search
from contid.kinematics.cosserat.solve import Problem, RodSolution

#: Further searches at most, and the change of pressure below which an answer is settled [bar].
MOST_SEARCHES, SETTLED_BAR = 4, 1e-7


def search_settled(problem: Problem, seed: Array, error: float = np.inf, effort: Effort = THOROUGH) -> Found:
    """`search`, repeated from its own answer to a redundant target until that stays.

    Args:
        problem: what to solve, with the minimum number of elements.
        seed: the last commanded pressures [bar].
        error: estimated discretisation error [mm] at which the elements are doubled.
        effort: of a search on the branch.
    """
    found = search(problem, seed, error, effort)
    if problem.task.rows >= problem.rod.pressures:
        return found
    for _ in range(MOST_SEARCHES):
        if not (found.outcome.met and found.stable) or _moved(found.outcome, seed) <= TRACKING:
            break
        again = search(problem, found.outcome.pressures, error, effort)
        spent = found.iterations + again.iterations
        found = replace(found, iterations=spent)
        if (
            not (again.outcome.met and again.stable)
            or _moved(again.outcome, found.outcome.pressures) <= SETTLED_BAR
        ):
            break
        if not _reached(problem, seed, again) and _reached(problem, seed, found):
            break
        found = replace(again, iterations=spent)
    return found


def _moved(outcome: RodSolution, seed: Array) -> float:
    return float(np.abs(outcome.pressures - seed).max())


def _reached(problem: Problem, seed: Array, found: Found) -> bool:
    """True when the arm gets from the seed to an answer on a straight path.

    Computed with the elements of that equilibrium: with fewer the same pressures hold another pose.
    """
    if problem.loads.is_zero:
        return True
    return reached_from(replace(problem, elements=found.elements), seed, found.outcome)
