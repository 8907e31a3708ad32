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
from contid.kinematics.cosserat.along_branch.beside import WIDE, Beside, StraightPose, nearest_probes
from contid.kinematics.cosserat.along_branch.corners import CORNERS, corner_starts, roughly_at
from contid.kinematics.cosserat.along_branch.descent import BranchDescent, StopRule, outcome_of
from contid.kinematics.cosserat.along_branch.effort import Effort, steps_for
from contid.kinematics.cosserat.along_branch.ramp import RAMP_WORK, BranchPose, ramped_work
from contid.kinematics.cosserat.along_branch.straight_path import FINE, NO_SNAP, at_target, snap_on_path
from contid.kinematics.cosserat.branch import equilibrium
from contid.kinematics.cosserat.solve import Problem, RodSolution
from contid.kinematics.cosserat.starts import unloaded
from contid.kinematics.cosserat.task import task_error

#: Work of one short descent, and its `StopRule`.
TRY_WORK = 60
TRY_GAIN, TRY_AHEAD, TRY_TRUST, TRY_ROOM = 1e-2, 8.0, 1e-2, 1e-2
#: Outcomes that are kept; those that are less apart are one [bar].
CANDIDATES, APART = 12, 0.05
#: The same of answers on the target to which no straight path leads.
DROPPED_APART = 0.2
#: The nearer starts next to a corner count where the tip is this part of the reach away from the others'.
SWINGS = 0.1
#: The part of the work that looks at starts may take, one over this.
LOOK_SHARE = 4


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
        #: Pressures of answers on the target to which no straight path leads, and poses beside these to which
        #: one does.
        self.dropped: list[Array] = []
        self.straight: list[StraightPose] = []

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
        if effort.around and self.met is None:
            self._around(self.candidates[0][1])
        for pressures in self.dropped:
            if self.met is None:
                self._beside(pressures)
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
                self._drop(o.pressures)
                return
        if o.met and not self._agrees_with_finer(o):
            return
        if o.met:
            self.met = o
        self._add(o.residual, descent.pose)

    def _drop(self, pressures: Array) -> None:
        if any(float(np.abs(pressures - known).max()) <= DROPPED_APART for known in self.dropped):
            return
        if len(self.dropped) < self.effort.beside:
            self.dropped.append(pressures)

    def _around(self, centre: BranchPose) -> None:
        """Descend from points around a pose, those nearest to the target first.

        Paths through the forks around it end on several sides of them.
        """
        for pose in nearest_probes(self.problem, centre.pressures, WIDE, self._pose_at):
            if self.met is None:
                self._attempt(pose, TRY_WORK)

    def _beside(self, pressures: Array) -> None:
        """Search beside an answer that was dropped; the search is over on the target."""
        stop = StopRule(TRY_WORK, TRY_GAIN, trust=TRY_TRUST, room=TRY_ROOM)
        near = Beside(self.problem, self.present, stop)
        near.run(pressures)
        self.work += near.work
        self.straight = sorted([*self.straight, *near.found], key=lambda one: one.error)
        if near.met:
            o = outcome_of(self.problem, near.found[0].pose)
            self.met = o if self._agrees_with_finer(o) else None

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
        return at.done == 1.0 and task_error(problem.task, at.sweep) <= o.residual + FINE

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
                seen.append((task_error(problem.task, found), pressures))
        self.work += len(points)
        for _, pressures in sorted(seen, key=lambda one: one[0]):
            if self.work >= most or self.met is not None:
                return
            start = self._pose_at(pressures)
            if start is not None:
                self._attempt(start, TRY_WORK)
