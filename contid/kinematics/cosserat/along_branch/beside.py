"""Poses beside an answer on the target to which the straight path from the present state does not lead.

Such a path passes a fork and ends on its other side. The forks that straight paths from one point meet are
surfaces in the space of pressures: around the answer there are points on both sides of them. A descent
from one that the arm gets to ends on the target, or is cut where the straight path no longer leads there.
Specification of ``contid/kernels/cosserat/along_branch/beside.hpp``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.along_branch.descent import BranchDescent, StopRule, outcome_of
from contid.kinematics.cosserat.along_branch.ramp import RAMP_WORK, BranchPose, ramped_work
from contid.kinematics.cosserat.along_branch.straight_path import NO_SNAP, snap_on_path
from contid.kinematics.cosserat.solve import Limits, Problem
from contid.kinematics.cosserat.task import task_error
from contid.kinematics.halton import PRIMES, radical_inverse

#: Points around an answer; half the width of their box, and of a second one, as a part of the range.
PROBES, WIDE, NARROW = 24, 0.13, 0.03
#: Descents, from the points nearest to the target, halvings of the way to where one ends, and poses kept.
PROBE_DESCENTS, HALVINGS, STRAIGHTS = 4, 7, 4


@dataclass(frozen=True, slots=True)
class StraightPose:
    """A pose to which a straight path leads, and its error [mm]; one leads to ``behind`` [bar] too."""

    error: float
    pose: BranchPose
    behind: Array


def probes(limits: Limits, around: Array, width: float) -> Iterator[Array]:
    """Points around pressures [bar], in a box that is twice ``width`` of their range."""
    spread = limits.upper - limits.lower
    for k in range(PROBES):
        share = np.array([radical_inverse(k + 1, PRIMES[axis]) for axis in range(len(around))])
        yield np.clip(around + width * (2.0 * share - 1.0) * spread, limits.lower, limits.upper)


def nearest_probes(
    problem: Problem, around: Array, width: float, pose_at: Callable[[Array], BranchPose | None]
) -> list[BranchPose]:
    """Poses at those of the `probes` where there is one, the few nearest to the target, nearest first."""
    poses = [pose_at(each) for each in probes(problem.limits, around, width)]
    there = [pose for pose in poses if pose is not None]
    return sorted(there, key=lambda pose: task_error(problem.task, pose.sweep))[:PROBE_DESCENTS]


class Beside:
    """The nearest poses around some pressures to which a straight path leads from ``present``."""

    def __init__(self, problem: Problem, present: BranchPose, stop: StopRule) -> None:
        self.problem, self.present, self.stop = problem, present, stop
        self.work = 0
        #: Nearest to the target first.
        self.found: list[StraightPose] = []

    @property
    def met(self) -> bool:
        """True where the nearest one is on the target."""
        return bool(self.found) and self.found[0].error <= self.problem.tolerance

    def run(self, pressures: Array) -> None:
        """Search around pressures [bar], then around the nearest pose found."""
        self._search(pressures, WIDE)
        if self.found and not self.met:
            self._search(self.found[0].pose.pressures, NARROW)

    def _search(self, around: Array, width: float) -> None:
        for pose in nearest_probes(self.problem, around, width, self._straight_at):
            if not self.met:
                self._attempt(pose)

    def _attempt(self, start: BranchPose) -> None:
        """From a pose towards the target.

        Where the straight path does not lead to the end of a descent, to the last point on the way there to
        which it does.
        """
        descent = BranchDescent(self.problem, start)
        o = descent.run(self.stop)
        self.work += o.iterations
        good = start
        if self._is_straight(descent.pose):
            good = descent.pose
        else:
            low, high = 0.0, 1.0
            for _ in range(HALVINGS):
                part = 0.5 * (low + high)
                pose = self._straight_at(start.pressures + part * (o.pressures - start.pressures))
                if pose is not None and self._error(pose) < self._error(good):
                    low, good = part, pose
                else:
                    high = part
        self.found.append(StraightPose(self._error(good), good, start.pressures))
        self.found.sort(key=lambda one: one.error)
        del self.found[STRAIGHTS:]

    def _straight_at(self, pressures: Array) -> BranchPose | None:
        """The pose on the branch, where the arm gets to it on the straight path too."""
        pose, work = ramped_work(self.problem, pressures)
        self.work += work
        return pose if pose is not None and self._is_straight(pose) else None

    def _is_straight(self, pose: BranchPose) -> bool:
        self.work += RAMP_WORK
        here, o = self.present, outcome_of(self.problem, pose)
        return snap_on_path(self.problem, here.pressures, here.base_moment, o) == NO_SNAP

    def _error(self, pose: BranchPose) -> float:
        return task_error(self.problem.task, pose.sweep)
