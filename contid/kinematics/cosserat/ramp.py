"""The way from rest to a pose, kept for the poses next to it.

Whether a pose is on its branch is known once the way from rest has been followed (`branch.equilibrium`).
Beside a way that is known it suffices that each of its points has a stable equilibrium close by, which costs
a sweep a point. Specification of ``contid/kernels/cosserat/ramp.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.branch import SAME_POSE, Followed, Station, follow, load_scale
from contid.kinematics.cosserat.solve import Problem
from contid.kinematics.cosserat.stability import unstable_modes
from contid.kinematics.cosserat.statics import Sweep, sweep

#: Points that are kept; the last ones are left out where there are more.
MOST_POINTS = 12
#: How far an equilibrium may be from its prediction beside a way, as a part of `load_scale`.
NEAR = 0.02

#: Parts of a way and the base moments there [N·mm].
Ramp = tuple[tuple[float, Array], ...]


@dataclass(frozen=True, slots=True)
class BranchPose:
    """An equilibrium on the branch, and the way to it from rest."""

    pressures: Array
    base_moment: Array
    sweep: Sweep
    ramp: Ramp


def ramped(problem: Problem, pressures: Array) -> BranchPose | None:
    """`branch.equilibrium` of a loaded rod that keeps the way; None where it ends short of the pressures."""
    passed: list[tuple[float, Array]] = []
    loads = problem.loads
    rest = Station(np.zeros(problem.rod.pressures), loads.scaled(0.0))
    at: Followed = follow(
        problem.rod, rest, Station(pressures, loads), np.zeros(3), problem.elements, passed=passed
    )
    if at.done < 1.0:
        return None
    return BranchPose(pressures, at.base_moment, at.sweep, tuple(passed[:-1][:MOST_POINTS]))


def beside(problem: Problem, pressures: Array, base_moment: Array, known: BranchPose) -> Ramp | None:
    """The way to an equilibrium that runs next to a known one; None where it does not."""
    near = NEAR * load_scale(problem.rod, problem.loads)
    moved = []
    for part, moment in known.ramp:
        guess = moment + part * (base_moment - known.base_moment)
        p, loads = part * pressures, problem.loads.scaled(part)
        found = sweep(problem.rod, p, guess, loads, problem.elements, tangents=True)
        assert found.tangents is not None
        try:
            left = np.linalg.solve(found.tangents.moment[:, :3], found.moment)
        except np.linalg.LinAlgError:
            return None
        if not float(np.linalg.norm(left)) <= near:
            return None
        if unstable_modes(problem.rod, p, guess, loads, problem.elements) > 0:
            return None
        moved.append((part, guess - left))
    return tuple(moved)


def same_pose(problem: Problem, base_moment: Array, other: Array) -> bool:
    """True when two base moments belong to one equilibrium."""
    scale = load_scale(problem.rod, problem.loads)
    return float(np.linalg.norm(base_moment - other)) <= SAME_POSE * scale


def way_to(
    problem: Problem, pressures: Array, base_moment: Array, known: BranchPose
) -> tuple[Ramp | None, bool]:
    """The way to an equilibrium near a known pose, None off the branch; and whether it was followed."""
    ramp = beside(problem, pressures, base_moment, known)
    if ramp is not None:
        return ramp, False
    other = ramped(problem, pressures)
    kept = other is not None and same_pose(problem, other.base_moment, base_moment)
    return (other.ramp if other is not None and kept else None), True
