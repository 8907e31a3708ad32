"""Descents along the branch from several starts, bounded in their work: short ones, longer of the best.

For a loaded arm where a descent from the last command did not end on the target and on the branch. Bounded
least squares has many local minima there, and most descents of an unreachable target end at corners of the
box or where the arm would snap: starts are the points next to the corners, those nearest to the target first.
Specification of ``contid/kernels/cosserat/along_branch/branch_search.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.along_branch.descent import BranchDescent, StopRule, outcome_of
from contid.kinematics.cosserat.along_branch.ramp import RAMP_WORK, BranchPose, ramped_work
from contid.kinematics.cosserat.along_branch.straight_path import FINE, NO_SNAP, at_target, snap_on_path
from contid.kinematics.cosserat.branch import MAX_ELEMENTS, equilibrium, load_scale
from contid.kinematics.cosserat.solve import Problem, RodSolution
from contid.kinematics.cosserat.stability import unstable_modes
from contid.kinematics.cosserat.starts import predicted_moment, unloaded
from contid.kinematics.cosserat.statics import Sweep, sweep
from contid.kinematics.cosserat.task import residual
from contid.kinematics.halton import PRIMES, radical_inverse

#: Work of one short descent, and its `StopRule`.
TRY_WORK = 60
TRY_GAIN, TRY_AHEAD, TRY_TRUST, TRY_ROOM = 1e-2, 8.0, 1e-2, 1e-2
#: Outcomes that are kept; those that are less apart are one [bar].
CANDIDATES, APART = 12, 0.05
#: Corners that are looked at, and how far the points next to them lie in the box, as parts of its range.
CORNERS, INSETS = 64, (0.06, 2e-3)
#: The nearer ones count where the tip is this part of the reach away from those of the others.
SWINGS = 0.1
#: A first look at a start: steps from rest, corrections, and balance as a part of `load_scale`.
LOOK_STEPS, LOOK_CORRECTIONS, ROUGH = 4, 4, 1e-2
#: The part of the work that looks may take, one over this.
LOOK_SHARE = 4


@dataclass(frozen=True, slots=True)
class Effort:
    """How much a search may do.

    Attributes:
        work: steps of the short descents, for two sections of three elements (`steps_for`).
        sets: starts next to every corner: see `corner_starts`.
        look_elements: of a look at a start.
        longer, long_work: number of longer descents, of the best of these, and steps of each.
        last_work: steps of the last descents (`last_descents`), as ``work``.
        again: most elements with which a search is made again where these lose an answer on the target.
        restarts: of solves without a load, from further points of the box.
    """

    work: int
    sets: int
    look_elements: int
    longer: int
    long_work: int
    last_work: int
    again: int
    restarts: int


#: In the control loop (a few ticks), and elsewhere.
TICK = Effort(work=450, sets=1, look_elements=2, longer=1, long_work=60, last_work=140, again=6, restarts=20)
THOROUGH = Effort(
    work=2000,
    sets=4,
    look_elements=3,
    longer=12,
    long_work=200,
    last_work=3000,
    again=MAX_ELEMENTS,
    restarts=100,
)


@dataclass(frozen=True, slots=True)
class Found:
    """The best outcome, whether it is stable, the elements it took, and all iterations spent.

    ``snap`` is that on the path to an equilibrium on the target: see `snap_on_path`.
    """

    outcome: RodSolution
    stable: bool
    elements: int
    iterations: int
    snap: float = NO_SNAP


class BranchSearch:
    """A search for one task; ``seed`` are the last commanded pressures [bar].

    Short descents of many starts, longer ones of the best of them. An answer on the target counts only where
    the present state leads to it on a straight path.
    """

    def __init__(self, problem: Problem, seed: Array, effort: Effort) -> None:
        self.problem, self.effort = problem, effort
        self.seed = np.clip(seed, problem.limits.lower, problem.limits.upper)
        self.work, self.snap = 0, NO_SNAP
        #: The best poses and their errors [mm], nearest to the target first.
        self.candidates: list[tuple[float, BranchPose]] = []
        self.met: RodSolution | None = None

    def run(self) -> Found | None:
        """The best outcome; None when the branch has no pose at the seed: the arm is left alone."""
        problem, effort = self.problem, self.effort
        present = self._pose_at(self.seed)
        if present is None:
            return None
        self.present = present
        self._attempt(present, TRY_WORK)
        if self.met is None:
            closed = unloaded(problem.rod, problem.task, problem.limits)
            start = None if closed is None else self._pose_at(closed)
            if start is not None:
                self._attempt(start, TRY_WORK)
        if self.met is None:
            self._elsewhere(steps_for(problem, effort.work))
        for k in range(effort.longer):
            if self.met is None and k < len(self.candidates):
                self._attempt(self.candidates[k][1], effort.long_work)
        best = outcome_of(problem, self.candidates[0][1]) if self.met is None else self.met
        return Found(best, True, problem.elements, self.work, self.snap if self.met is None else NO_SNAP)

    def _pose_at(self, pressures: Array) -> BranchPose | None:
        pose, work = ramped_work(self.problem, pressures)
        self.work += work
        return pose

    def _attempt(self, start: BranchPose, most: int) -> None:
        """Descend from one start; the search is over on the target."""
        best, ahead = (self.candidates[0][0], TRY_AHEAD) if self.candidates else (0.0, 0.0)
        descent = BranchDescent(self.problem, start)
        o = descent.run(StopRule(most, TRY_GAIN, best, ahead, TRY_TRUST, TRY_ROOM))
        self.work += o.iterations
        if len(self.candidates) == CANDIDATES and not o.residual < self.candidates[-1][0]:
            return
        if at_target(o):
            self.work += RAMP_WORK
            leaves = snap_on_path(self.problem, self.present.pressures, self.present.base_moment, o)
            self.snap = min(self.snap, leaves)
            if leaves < NO_SNAP:
                return
        if o.met and not self._agrees_with_finer(o):
            return
        if o.met:
            self.met = o
        self._add(o.residual, descent.pose)

    def _add(self, error: float, pose: BranchPose) -> None:
        """Add the end of a descent to the best, in place of a worse one next to it."""
        for k, (other, known) in enumerate(self.candidates):
            if float(np.abs(pose.pressures - known.pressures).max()) <= APART:
                if not error < other:
                    return
                del self.candidates[k]
                break
        self.candidates.append((error, pose))
        self.candidates.sort(key=lambda one: one[0])
        del self.candidates[CANDIDATES:]

    def _agrees_with_finer(self, o: RodSolution) -> bool:
        """True when twice the elements agree with an outcome; too few bend the branch where it is steep."""
        self.work += 2 * RAMP_WORK
        problem = self.problem
        at = equilibrium(problem.rod, o.pressures, problem.loads, 2 * problem.elements)
        return at.done == 1.0 and float(np.linalg.norm(residual(problem.task, at.sweep))) <= o.residual + FINE

    def _elsewhere(self, most: int) -> None:
        """Starts nearest to the target first, by a coarse look at all.

        In few steps, or by a path where these do not get there, as long as ``most`` lasts.
        """
        problem = self.problem
        coarse = replace(problem, elements=self.effort.look_elements)
        seen: list[tuple[float, Array]] = []
        tips: dict[int, Array] = {}
        corners = min(2**problem.rod.pressures, CORNERS)
        points = corner_starts(problem, self.effort.sets)[: most // LOOK_SHARE]
        spare = most
        for index, pressures in enumerate(points):
            found = roughly_at(coarse, pressures)
            if found is None and spare > 0:
                pose, work = ramped_work(coarse, pressures)
                spare -= work
                found = None if pose is None else pose.sweep
            if found is None:
                continue
            corner = (index - 1) % corners
            others = (corner, corner + corners + 1) if index > 2 * corners else ()
            apart = SWINGS * problem.rod.reach
            same = any(k in tips and float(np.linalg.norm(tips[k] - found.tip)) < apart for k in others)
            tips[index] = found.tip
            if not same:
                seen.append((float(np.linalg.norm(residual(problem.task, found))), pressures))
        self.work += len(points)
        for _, pressures in sorted(seen, key=lambda one: one[0]):
            if self.work >= most or self.met is not None:
                return
            start = self._pose_at(pressures)
            if start is not None:
                self._attempt(start, TRY_WORK)


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


def steps_for(problem: Problem, cost: int) -> int:
    """How many steps a cost allows, which is in steps of two sections of three elements."""
    return 6 * cost // (problem.elements * len(problem.rod.sections))


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
