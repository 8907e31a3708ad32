"""Descents along the branch from several starts, bounded in their work.

For a loaded arm where a descent from the last command did not end on the target and on the branch. Bounded
least squares has many local minima there, and most descents of an unreachable target end at corners of the
box or where the arm would snap: starts are the points next to the corners, those nearest to the target first.
Specification of ``contid/kernels/cosserat/branch_search.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.branch import Station, equilibrium, follow
from contid.kinematics.cosserat.descent import RAMP_WORK, StopRule, descend, outcome_of
from contid.kinematics.cosserat.ramp import BranchPose, ramped, same_pose
from contid.kinematics.cosserat.solve import Problem, RodSolution
from contid.kinematics.cosserat.starts import unloaded
from contid.kinematics.cosserat.task import residual
from contid.kinematics.halton import PRIMES, radical_inverse

#: Work of a search elsewhere for two sections of three elements (`allowed_work`), and of one descent.
WORK, TRY_WORK = 280, 40
#: `StopRule` of descents once there is an outcome.
TRY_GAIN, TRY_AHEAD, TRY_TRUST = 1e-2, 8.0, 1e-2
#: Corners that are looked at, and how far the points next to them lie in the box, as a part of its range.
CORNERS, INSET = 64, 0.06
#: Elements of the first, coarse ranking of the starts, which takes at most 1 / `LOOK_SHARE` of the work.
LOOK_ELEMENTS, LOOK_SHARE = 2, 4
#: How much worse an outcome may be with twice the elements [mm].
FINE = 1.0


@dataclass(frozen=True, slots=True)
class Found:
    """The best outcome, whether it is stable, the elements it took, and all iterations spent.

    ``snap`` is the part of the path to an equilibrium on the target at which the arm snaps through; 1 for
    none.
    """

    outcome: RodSolution
    stable: bool
    elements: int
    iterations: int
    snap: float = 1.0


class BranchSearch:
    """A search for one task; ``seed`` are the last commanded pressures [bar].

    An answer on the target counts only where the present state leads to it on a straight path.
    """

    def __init__(self, problem: Problem, seed: Array) -> None:
        self.problem = problem
        self.seed = np.clip(seed, problem.limits.lower, problem.limits.upper)
        self.work, self.snap = 0, 1.0
        self.best: RodSolution | None = None

    def run(self) -> Found | None:
        """The best outcome; None when the branch has no pose at the seed: the arm is left alone."""
        problem = self.problem
        present = self._pose_at(self.seed)
        if present is None:
            return None
        self._present = present
        over = self._attempt(present, here=True)
        if not over:
            closed = unloaded(problem.rod, problem.task, problem.limits)
            start = None if closed is None else self._pose_at(closed)
            over = start is not None and self._attempt(start)
        if not over:
            self._elsewhere(self.work + allowed_work(problem))
        assert self.best is not None
        snap = 1.0 if self.best.met else self.snap
        return Found(self.best, True, problem.elements, self.work, snap)

    def _pose_at(self, pressures: Array) -> BranchPose | None:
        self.work += RAMP_WORK
        return ramped(self.problem, pressures)

    def _attempt(self, start: BranchPose, here: bool = False) -> bool:
        """Descend from one start; True when the search is over."""
        stop = StopRule(TRY_WORK)
        if self.best is not None:
            stop = StopRule(TRY_WORK, TRY_GAIN, self.best.residual, TRY_AHEAD, TRY_TRUST)
        o = self._descended(start, stop)
        if self.best is not None and not o.residual < self.best.residual:
            return False
        if o.met and not here:
            reached, done = self._reaches(o)
            if not reached:
                self.snap = min(self.snap, done)
                return False
        self.best = o
        return o.met

    def _descended(self, start: BranchPose, stop: StopRule) -> RodSolution:
        """A descent; one that is better than others ends on the branch."""
        o = descend(self.problem, start, stop)
        self.work += o.iterations
        if self.best is not None and not o.residual < self.best.residual:
            return o
        end = self._pose_at(o.pressures)
        kept = end is not None and same_pose(self.problem, end.base_moment, o.base_moment)
        return o if kept and self._agrees_with_finer(o) else outcome_of(self.problem, start)

    def _agrees_with_finer(self, o: RodSolution) -> bool:
        """True when twice the elements agree with an outcome; too few bend the branch where it is steep."""
        self.work += 2 * RAMP_WORK
        problem = self.problem
        at = equilibrium(problem.rod, o.pressures, problem.loads, 2 * problem.elements)
        return at.done == 1.0 and float(np.linalg.norm(residual(problem.task, at.sweep))) <= o.residual + FINE

    def _reaches(self, o: RodSolution) -> tuple[bool, float]:
        self.work += RAMP_WORK
        return reaches(self.problem, self._present.pressures, self._present.base_moment, o)

    def _elsewhere(self, most: int) -> None:
        """Starts nearest to the target first, by a coarse look at all."""
        problem = self.problem
        coarse = replace(problem, elements=LOOK_ELEMENTS)
        seen: list[tuple[float, Array]] = []
        for pressures in corner_starts(problem)[: (most - self.work) // LOOK_SHARE]:
            self.work += 1
            pose = ramped(coarse, pressures)
            if pose is not None:
                seen.append((float(np.linalg.norm(residual(problem.task, pose.sweep))), pressures))
        for _, pressures in sorted(seen, key=lambda one: one[0]):
            if self.work >= most:
                return
            start = self._pose_at(pressures)
            if start is not None and self._attempt(start):
                return


def reaches(problem: Problem, here: Array, base_moment: Array, outcome: RodSolution) -> tuple[bool, float]:
    """Whether the arm gets from one equilibrium to another on a straight path, and what part of it."""
    start, end = Station(here, problem.loads), Station(outcome.pressures, problem.loads)
    path = follow(problem.rod, start, end, base_moment, problem.elements)
    return path.done == 1.0 and same_pose(problem, path.base_moment, outcome.base_moment), path.done


def allowed_work(problem: Problem) -> int:
    """Work that a search elsewhere may take: the cost of a step grows with elements and sections."""
    return 6 * WORK // (problem.elements * len(problem.rod.sections))


def corner_starts(problem: Problem) -> list[Array]:
    """Points next to corners of the box, off planes of symmetry, where ways fork; then its centre."""
    limits, n = problem.limits, problem.rod.pressures
    spread = limits.upper - limits.lower
    points = []
    for index in range(min(2**n, CORNERS)):
        share = np.array([radical_inverse(index + 1, PRIMES[axis]) for axis in range(n)])
        high = np.array([index >> axis & 1 for axis in range(n)], bool) if n <= 6 else share >= 0.5
        inset = INSET * share * spread
        points.append(np.where(high, limits.upper - inset, limits.lower + inset))
    return [*points, limits.centre]
