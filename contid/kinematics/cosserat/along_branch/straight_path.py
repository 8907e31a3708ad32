"""The straight path in pressures from where the arm stands to an answer, and whether an answer counts.

Specification of ``contid/kernels/cosserat/along_branch/straight_path.hpp``.
"""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.along_branch.ramp import same_pose
from contid.kinematics.cosserat.branch import Followed, Station, equilibrium, follow
from contid.kinematics.cosserat.solve import BALANCE_TOLERANCE, Problem, RodSolution
from contid.kinematics.cosserat.stability import unstable_modes

#: An outcome as near to its target must be reached on the straight path [mm].
FINE = 1.0


def at_target(outcome: RodSolution) -> bool:
    """True for an outcome on the target or next to it: the arm must get there on the straight path."""
    return outcome.met or outcome.residual <= FINE


def reaches(problem: Problem, here: Array, base_moment: Array, outcome: RodSolution) -> tuple[bool, float]:
    """Whether the arm gets from one equilibrium to another on a straight path, and what part of it."""
    start, end = Station(here, problem.loads), Station(outcome.pressures, problem.loads)
    path = follow(problem.rod, start, end, base_moment, problem.elements)
    return path.done == 1.0 and same_pose(problem, path.base_moment, outcome.base_moment), path.done


def standing(problem: Problem, seed: Array) -> tuple[Array, Followed]:
    """Where the arm stands: the seed within the limits, and the path from rest to its equilibrium."""
    here = np.clip(seed, problem.limits.lower, problem.limits.upper)
    return here, equilibrium(problem.rod, here, problem.loads, problem.elements)


def reached_from(problem: Problem, seed: Array, outcome: RodSolution) -> bool:
    """True when the arm gets from the seed to an equilibrium on a straight path, or has none at the seed."""
    here, present = standing(problem, seed)
    return present.done < 1.0 or reaches(problem, here, present.base_moment, outcome)[0]


def holds(problem: Problem, outcome: RodSolution) -> bool:
    """True where an answer is the equilibrium of its pressures on the branch."""
    at = equilibrium(problem.rod, outcome.pressures, problem.loads, problem.elements)
    return at.done == 1.0 and same_pose(problem, at.base_moment, outcome.base_moment)


def is_stable(problem: Problem, outcome: RodSolution) -> bool:
    """True for an equilibrium that is a minimum of energy."""
    if outcome.statics > BALANCE_TOLERANCE:
        return False
    if problem.loads.is_zero:
        return True
    return (
        unstable_modes(problem.rod, outcome.pressures, outcome.base_moment, problem.loads, problem.elements)
        == 0
    )
