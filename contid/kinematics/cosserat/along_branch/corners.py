"""Where descents along the branch start: points next to corners of the box, and a first look at each.

Specification of the same functions of ``contid/kernels/cosserat/along_branch/branch_search.hpp``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.branch import load_scale
from contid.kinematics.cosserat.solve import Problem
from contid.kinematics.cosserat.stability import unstable_modes
from contid.kinematics.cosserat.starts import predicted_moment
from contid.kinematics.cosserat.statics import Sweep, sweep
from contid.kinematics.halton import PRIMES, radical_inverse

#: Corners that are looked at, and how far the points next to them lie in the box, as parts of its range.
CORNERS, INSETS = 64, (0.06, 2e-3)
#: A first look at a start: steps from rest, corrections, and balance as a part of `load_scale`.
LOOK_STEPS, LOOK_CORRECTIONS, ROUGH = 4, 4, 1e-2


def corner_starts(problem: Problem, sets: int) -> list[Array]:
    """Points next to corners of the box, off planes of symmetry, where paths fork; its centre; more ``sets``.

    The second is on other sides of those planes; two more are nearer to the corners, for arms that swing far
    there.
    """
    limits, n = problem.limits, problem.rod.pressures
    spread = limits.upper - limits.lower
    points: list[list[Array]] = [[], [], [], []]
    for index in range(min(2**n, CORNERS)):
        share = np.array([radical_inverse(index + 1, PRIMES[axis]) for axis in range(n)])
        high = np.array([index >> axis & 1 for axis in range(n)], bool) if n <= 6 else share >= 0.5
        for k in range(sets):
            inset = INSETS[k // 2] * (1.0 - share if k % 2 else share) * spread
            points[k].append(np.where(high, limits.upper - inset, limits.lower + inset))
    first, *others = points
    return [*first, limits.centre, *(point for one in others for point in one)]


def roughly_at(problem: Problem, pressures: Array) -> Sweep | None:
    """About where the arm is with given pressures, in few steps from rest; None where that is not stable."""
    rod, loads = problem.rod, problem.loads
    enough = ROUGH * load_scale(rod, loads)
    straight = replace(problem.task, tip=np.array([0.0, 0.0, rod.reach]))
    last = before = np.zeros(3)
    for k in range(1, LOOK_STEPS + 1):
        part = k / LOOK_STEPS
        p, share = part * pressures, loads.scaled(part)
        moment = predicted_moment(rod, straight, share) if k == 1 else 2.0 * last - before
        near = False
        for _ in range(LOOK_CORRECTIONS):
            found, judged = sweep(rod, p, moment, share, problem.elements, tangents=True), moment
            assert found.tangents is not None
            near = float(np.linalg.norm(found.moment)) <= enough
            try:
                moment = moment - np.linalg.solve(found.tangents.moment[:, :3], found.moment)
            except np.linalg.LinAlgError:
                return None
            if unstable_modes(rod, p, judged, share, problem.elements) > 0:
                return None
            if near:
                break
        if not near:
            return None
        before, last = last, moment
    return found
