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
#: Instead of the part of a path at which the arm snaps through: it does not, and ends where it should.
NO_SNAP = 2.0


def at_target(outcome: RodSolution) -> bool:
    """True for an outcome on the target or next to it: the arm must get there on the straight path."""
    return outcome.met or outcome.residual <= FINE


def snap_on_path(problem: Problem, here: Array, base_moment: Array, outcome: RodSolution) -> float:
    """The part of the straight path from an equilibrium to another at which the arm snaps through.

    1 where it ends elsewhere without a snap, `NO_SNAP` where it gets there.
    """
    start, end = Station(here, problem.loads), Station(outcome.pressures, problem.loads)
    path = follow(problem.rod, start, end, base_moment, problem.elements)
    there = path.done == 1.0 and same_pose(problem, path.base_moment, outcome.base_moment)
    return NO_SNAP if there else path.done


def standing(problem: Problem, seed: Array) -> tuple[Array, Followed]:
    """Where the arm stands: the seed within the limits, and the path from rest to its equilibrium."""
    here = np.clip(seed, problem.limits.lower, problem.limits.upper)
    return here, equilibrium(problem.rod, here, problem.loads, problem.elements)


def snap_from(problem: Problem, seed: Array, outcome: RodSolution) -> float:
    """`snap_on_path` from the seed; `NO_SNAP` too where the arm has no equilibrium there."""
    here, present = standing(problem, seed)
    return NO_SNAP if present.done < 1.0 else snap_on_path(problem, here, present.base_moment, outcome)


def reached_from(problem: Problem, seed: Array, outcome: RodSolution) -> bool:
    """True when the arm gets from the seed to an equilibrium on a straight path, or has none at the seed."""
    return snap_from(problem, seed, outcome) == NO_SNAP


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
