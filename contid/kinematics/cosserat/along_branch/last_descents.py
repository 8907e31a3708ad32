"""The last descents of answers out of reach: from the candidates of a search, with the elements they need.

Specification of ``contid/kernels/cosserat/along_branch/last_descents.hpp``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.along_branch.branch_search import BranchSearch, Found
from contid.kinematics.cosserat.along_branch.descent import StopRule, descend, outcome_of
from contid.kinematics.cosserat.along_branch.effort import steps_for
from contid.kinematics.cosserat.along_branch.ramp import RAMP_WORK, BranchPose, ramped, ramped_work
from contid.kinematics.cosserat.along_branch.straight_path import NO_SNAP, at_target, snap_from, standing
from contid.kinematics.cosserat.branch import equilibrium
from contid.kinematics.cosserat.discretisation import fine_equilibrium, is_fine
from contid.kinematics.cosserat.solve import Problem, RodSolution
from contid.kinematics.cosserat.task import task_error

#: The least work of one of them, and that of going on from the best (as `Effort.last_work`).
LEAST_WORK, FINISH_WORK = 12, 40
#: Their `StopRule`.
LAST_GAIN, LAST_AHEAD, LAST_TRUST = 1e-3, 8.0, 1e-5
#: How far twice the elements may be from an outcome, in units of ``error``.
CERTAIN = 3.0
#: First part of the path back to the seed where more elements find an answer unstable.
RETREAT = 2e-3


def pose_near(problem: Problem, pressures: Array, seed: Array) -> tuple[BranchPose | None, int]:
    """The pose on the branch with given pressures; where there is none, one next to it, towards the seed.

    With the work of the path to it.
    """
    limits, part = problem.limits, 0.0
    while part < 1.0:
        p = np.clip(pressures + part * (seed - pressures), limits.lower, limits.upper)
        pose, work = ramped_work(problem, p)
        if pose is not None:
            return pose, work
        part = 4.0 * part if part > 0.0 else RETREAT
    return None, 0


def standing_error(problem: Problem, seed: Array, error: float) -> float:
    """How far from the target the arm stands, and ``error`` [mm]; infinite where elements find no pose."""
    _, at = standing(problem, seed)
    return task_error(problem.task, at.sweep) + error if at.done == 1.0 else np.inf


class LastDescents:
    """Descends from the candidates of a search with the elements that they need.

    An answer is never farther from the target than where the arm stands. ``error`` is the estimated
    discretisation error [mm] at which the elements are doubled.
    """

    def __init__(self, problem: Problem, seed: Array, error: float, cost: int) -> None:
        self.problem, self.seed, self.error = problem, seed, error
        self.cost_left, self.spent, self.snap = cost, 0, NO_SNAP
        self.best: Found | None = None
        #: The best one, to which a straight path leads, is left where it is.
        self.stays = False

    def run(self, search: BranchSearch) -> Found | None:
        """The best outcome; None where none counts."""
        elements = search.problem.elements
        for _, pose in search.candidates:
            if self.cost_left > 0:
                self._attempt(pose.pressures, elements, descends=True)
        for _, pose in search.candidates:
            if self.best is None:
                self._attempt(pose.pressures, elements, descends=False)
        for one in search.straight:
            self._attempt(one.pose.pressures, elements, descends=False, behind=one.behind)
        self._stay()
        if self.best is None:
            return None
        if not (self.stays or self.best.outcome.optimal):
            self._finish(self.best)
        return replace(self.best, snap=min(self.snap, search.snap), iterations=self.spent)

    def _spend(self, steps: int, elements: int) -> None:
        self.spent += steps
        self.cost_left -= (steps * elements * len(self.problem.rod.sections) + 5) // 6

    def _attempt(self, start: Array, elements: int, descends: bool, behind: Array | None = None) -> None:
        """Take a pose with given pressures, or the end of a descent from it, if better than the best.

        With pressures ``behind`` only a pose, or one on the way back to these, to which the straight path
        from the seed leads.
        """
        pressures = start
        while True:
            finer = replace(self.problem, elements=elements)
            pose, work = pose_near(finer, pressures, self.seed)
            if pose is None:
                return
            self._spend(work, elements)
            o = outcome_of(finer, pose)
            if self._is_fine(o, elements):
                if not descends:
                    break
                best, ahead = (0.0, 0.0) if self.best is None else (self.best.outcome.residual, LAST_AHEAD)
                work = max(steps_for(finer, self.cost_left), LEAST_WORK)
                o = descend(finer, pose, StopRule(work, LAST_GAIN, best, ahead, LAST_TRUST))
                self._spend(o.iterations, elements)
                if self._is_fine(o, elements):
                    break
            pressures = o.pressures
            elements *= 2
        self._take(finer, o, start, behind)

    def _take(self, problem: Problem, end: RodSolution, start: Array, behind: Array | None) -> None:
        """Take an outcome, or one on the way back, if it is certain and better than the best.

        The way back is to ``behind``, without to ``start``. From an outcome on the target, too, only a pose
        counts to which the straight path leads.
        """
        o, part = end, 0.0
        straight, back = behind is not None or at_target(end), start if behind is None else behind
        while part < 1.0:
            pose: BranchPose | None = None
            if part > 0.0:
                self._spend(RAMP_WORK, problem.elements)
                pose = ramped(problem, end.pressures + part * (back - end.pressures))
                o = o if pose is None else outcome_of(problem, pose)
            if part == 0.0 or pose is not None:
                if self.best is not None and not o.residual < self.best.outcome.residual:
                    return
                if self._is_fine(o, problem.elements) and self._is_certain(o, problem.elements, straight):
                    self.best = Found(o, True, problem.elements, 0)
                    self.stays = behind is not None or (straight and part > 0.0)
                    return
            part = 4.0 * part if part > 0.0 else RETREAT

    def _stay(self) -> None:
        """Take where the arm stands if that is nearer; it may need more elements than the search."""
        p = self.problem
        pressures = np.clip(self.seed, p.limits.lower, p.limits.upper)
        at, elements = fine_equilibrium(p.rod, pressures, p.loads, p.elements, self.error)
        self._spend(RAMP_WORK, elements)
        if at.done < 1.0:
            return
        pose = BranchPose(pressures, at.base_moment, at.sweep, (), at.least)
        o = outcome_of(replace(p, elements=elements), pose)
        if self.best is None or o.residual < self.best.outcome.residual:
            self.best, self.stays = Found(o, True, elements, 0), False

    def _finish(self, best: Found) -> None:
        """Go on from the best one until no step helps: only then it is known to be an optimum."""
        finer = replace(self.problem, elements=best.elements)
        pose, work = ramped_work(finer, best.outcome.pressures)
        if pose is None:
            return
        o = descend(finer, pose, StopRule(max(steps_for(finer, FINISH_WORK), LEAST_WORK)))
        self._spend(work + o.iterations, best.elements)
        nearer = o.residual <= best.outcome.residual and self._is_fine(o, best.elements)
        if nearer and self._is_certain(o, best.elements):
            self.best = replace(best, outcome=o)

    def _is_fine(self, o: RodSolution, elements: int) -> bool:
        p = self.problem
        return is_fine(p.rod, o.pressures, o.base_moment, p.loads, elements, o.sweep, self.error)

    def _is_certain(self, o: RodSolution, elements: int, straight: bool = False) -> bool:
        """True where `forward` has the tip of an outcome, and a path with twice the elements too.

        Next to the boundary the elements decide on which side the arm is. ``straight``: the straight path
        from the seed must lead there, as it must to an outcome on the target.
        """
        p = self.problem
        self._spend(2 * RAMP_WORK, 2 * elements)
        if straight or at_target(o):
            leaves = snap_from(replace(p, elements=elements), self.seed, o)
            self.snap = min(self.snap, leaves)
            if leaves < NO_SNAP:
                return False
        at, _ = fine_equilibrium(p.rod, o.pressures, p.loads, p.elements, self.error)
        if at.done < 1.0 or float(np.linalg.norm(at.sweep.tip - o.sweep.tip)) > self.error:
            return False
        finer = equilibrium(p.rod, o.pressures, p.loads, 2 * elements)
        away = float(np.linalg.norm(finer.sweep.tip - o.sweep.tip))
        return finer.done == 1.0 and away <= CERTAIN * self.error
