"""More elements for an answer, where its estimated error demands them.

Specification of ``contid/kernels/cosserat/along_branch/refine.hpp``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.along_branch.branch_search import Found
from contid.kinematics.cosserat.along_branch.descent import StopRule, descend, outcome_of
from contid.kinematics.cosserat.along_branch.last_descents import pose_near
from contid.kinematics.cosserat.along_branch.ramp import same_pose
from contid.kinematics.cosserat.along_branch.straight_path import at_target, holds, is_stable, reached_from
from contid.kinematics.cosserat.discretisation import is_fine
from contid.kinematics.cosserat.solve import Problem, solve

#: Iterations from the seed or a coarser answer, and from each further start.
ITERATIONS = 60
RESTART_ITERATIONS = 25
#: Iterations of a bounded optimum with more elements.
FINER_ITERATIONS = 6
#: An optimum this close to the seed continues a motion [bar].
TRACKING = 0.05


def refine(problem: Problem, found: Found, seed: Array, error: float, along: bool) -> Found:
    """Double the elements until the estimated error of tip and mid-point is at most ``error``.

    After a descent ``along`` the branch what counts is the pose that the straight path from rest reaches.
    """
    while found.stable:
        here, o = replace(problem, elements=found.elements), found.outcome
        if is_fine(here.rod, o.pressures, o.base_moment, here.loads, here.elements, o.sweep, error):
            break
        found, kept = _doubled(problem, found, seed)
        along = along or not kept
    return _settle_on_branch(problem, found, seed) if along and found.stable else found


def _doubled(problem: Problem, found: Found, seed: Array) -> tuple[Found, bool]:
    """An answer with twice the elements; False where it was lost and is a pose along the branch."""
    o, finer = found.outcome, replace(problem, elements=2 * found.elements)
    outcome = solve(finer, o.pressures, o.base_moment, ITERATIONS) if o.met else o
    near = float(np.abs(outcome.pressures - o.pressures).max()) <= TRACKING
    stable = True
    # More elements can end the branch before the pressures that fewer of them reach.
    kept = o.met and outcome.met and is_stable(finer, outcome) and near and holds(finer, outcome)
    if not kept:
        pose, _ = pose_near(finer, o.pressures, seed)
        stable = pose is not None
        if pose is not None:
            outcome = descend(finer, pose, StopRule(RESTART_ITERATIONS if o.met else FINER_ITERATIONS))
            if not holds(finer, outcome):
                outcome = outcome_of(finer, pose)
    return Found(outcome, stable, finer.elements, found.iterations + outcome.iterations, found.snap), kept


def _settle_on_branch(problem: Problem, found: Found, seed: Array) -> Found:
    """The pose that counts for pressures found along the branch; on the target the arm must get there."""
    here, o = replace(problem, elements=found.elements), found.outcome
    pose, _ = pose_near(here, o.pressures, seed)
    if pose is None:
        return replace(found, stable=False)
    same = same_pose(here, pose.base_moment, o.base_moment)
    if not (same and np.array_equal(pose.pressures, o.pressures)):
        o = outcome_of(here, pose)
    return replace(found, outcome=o, stable=not at_target(o) or reached_from(here, seed, o))
