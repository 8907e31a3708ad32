"""The path from rest to a pose, kept for the poses next to it.

Whether a pose is on its branch is known once the path from rest has been followed (`branch.equilibrium`).
Specification of ``contid/kernels/cosserat/along_branch/ramp.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.branch import SAME_POSE, Followed, Station, follow, load_scale
from contid.kinematics.cosserat.solve import Problem
from contid.kinematics.cosserat.statics import Sweep

#: Points that are kept; the last ones are left out where there are more.
MOST_POINTS = 24
#: The least cost of following a path from rest, in steps of a descent; each equilibrium on it costs one more.
RAMP_WORK = 3

#: Parts of a path and the base moments there [N·mm].
Ramp = tuple[tuple[float, Array], ...]


@dataclass(frozen=True, slots=True)
class BranchPose:
    """An equilibrium on the branch, the path to it from rest, and the least stiffness on that."""

    pressures: Array
    base_moment: Array
    sweep: Sweep
    ramp: Ramp
    least: float


def ramped(problem: Problem, pressures: Array) -> BranchPose | None:
    """`branch.equilibrium` of a loaded rod that keeps the path; None where it ends short of the pressures."""
    return ramped_work(problem, pressures)[0]


def ramped_work(problem: Problem, pressures: Array) -> tuple[BranchPose | None, int]:
    """The same, and its cost in steps of a descent."""
    passed: list[tuple[float, Array]] = []
    loads = problem.loads
    rest = Station(np.zeros(problem.rod.pressures), loads.scaled(0.0))
    at: Followed = follow(
        problem.rod, rest, Station(pressures, loads), np.zeros(3), problem.elements, passed=passed
    )
    work = RAMP_WORK + len(passed)
    if at.done < 1.0:
        return None, work
    return BranchPose(pressures, at.base_moment, at.sweep, tuple(passed[:-1][:MOST_POINTS]), at.least), work


def same_pose(problem: Problem, base_moment: Array, other: Array) -> bool:
    """True when two base moments belong to one equilibrium."""
    scale = load_scale(problem.rod, problem.loads)
    return float(np.linalg.norm(base_moment - other)) <= SAME_POSE * scale
