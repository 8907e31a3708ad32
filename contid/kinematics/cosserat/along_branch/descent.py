"""Descent of the task error along the branch and along its boundary: every step ends near the one before.

Slower than `solve`, which balances the moments on the way and may end in any equilibrium. Whether poses are
on the branch is checked every few steps, and at every step next to its boundary. Specification of
``contid/kernels/cosserat/along_branch/descent.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.along_branch.boundary import (
    LEAST_APPROACH,
    SHRINK,
    boundary_normal,
    limited_step,
)
from contid.kinematics.cosserat.along_branch.ramp import BranchPose, ramped_work, same_pose
from contid.kinematics.cosserat.box_step import box_step
from contid.kinematics.cosserat.branch import settle
from contid.kinematics.cosserat.equilibrium import STATICS_TOLERANCE
from contid.kinematics.cosserat.solve import TRUST_START, Problem, RodSolution
from contid.kinematics.cosserat.statics import Sweep
from contid.kinematics.cosserat.task import jacobian, residual, task_error

#: The least limits of a step and of the room in front of the boundary [bar].
NO_TRUST, LEAST_ROOM = 1e-6, 1e-4
#: A predicted reduction of the squared error that no longer matters, as a part of it.
NO_GAIN = 1e-9
#: Stiffness that paths must keep: nearer to a fork, other elements and other regulators go on on either side.
MARGIN = 0.01
#: Steps whose gain together decides whether a descent goes on.
RECENT = 5
#: Steps after which they are checked; steps away from the boundary that leave it.
UNCHECKED, RETREATS = 8, 2


@dataclass(frozen=True, slots=True)
class StopRule:
    """When a descent ends.

    Attributes:
        work: steps at most; a path followed from rest costs what `ramp.ramped_work` returns.
        gain: of the last `RECENT` steps together, the least, as a part of the error.
        best: error of another outcome [mm].
        ahead: ends where this multiple of that gain does not reach ``best``; 0 for never.
        trust, room: the least limit of a step, and the least room in front of the boundary [bar].
    """

    work: int
    gain: float = 0.0
    best: float = 0.0
    ahead: float = 0.0
    trust: float = NO_TRUST
    room: float = LEAST_ROOM


@dataclass(slots=True)
class _BranchPoint:
    pressures: Array
    base_moment: Array
    sweep: Sweep
    error: Array
    cost: float


class BranchDescent:
    """From one pose on the branch to others; ``start`` is inside the limits."""

    def __init__(self, problem: Problem, start: BranchPose) -> None:
        self.problem = problem
        #: The first is on the branch.
        self.points = [self._point(start.pressures, start.base_moment, start.sweep)]
        self.ramp, self.least = start.ramp, start.least
        self.margin = min(MARGIN, start.least)
        self.trust, self.room = TRUST_START, 0.0
        self.normal: Array | None = None
        self.work = self.steps = self.retreats = 0
        self.normal_is_old = self.stepped = self.blocked = self.optimal = False

    @property
    def pose(self) -> BranchPose:
        """The first of the points."""
        at = self.points[0]
        return BranchPose(at.pressures, at.base_moment, at.sweep, self.ramp, self.least)

    def run(self, stop: StopRule) -> RodSolution:
        """Until the stop rule ends it; the last pose is on the branch."""
        tolerance = self.problem.tolerance
        recent = [0.0] * RECENT
        self.stepped = True
        while True:
            now = self.points[-1]
            error = float(np.sqrt(now.cost))
            over = now.cost <= tolerance**2 or self.work >= stop.work
            if not over and self.stepped:
                gained = recent[self.steps % RECENT] - error
                hopeless = stop.ahead > 0.0 and error - stop.best > stop.ahead * gained
                over = self.steps >= RECENT and (gained < stop.gain * error or hopeless)
                recent[self.steps % RECENT] = error
                self.steps += 1
            if not over:
                self.work += 1
                over = not self._advance(stop)
            if not over:
                continue
            if self._check() or self.work >= stop.work:
                break
            self.optimal = False
        end = self.points[0]
        met = end.cost <= tolerance**2
        return RodSolution(
            end.pressures, end.base_moment, float(np.sqrt(end.cost)), float(np.linalg.norm(end.sweep.moment)),
            met, met or self.optimal, self.work, end.sweep, self.blocked and not met,
        )  # fmt: skip

    def _point(self, pressures: Array, base_moment: Array, found: Sweep) -> _BranchPoint:
        r = residual(self.problem.task, found)
        return _BranchPoint(pressures, base_moment, found, r, float(r @ r))

    def _on_branch_at(self, at: _BranchPoint) -> bool:
        pose, work = ramped_work(self.problem, at.pressures)
        self.work += work
        if pose is None or pose.least < self.margin:
            return False
        if not same_pose(self.problem, pose.base_moment, at.base_moment):
            return False
        self._path = pose.ramp, pose.least
        return True

    def _set_boundary(self, step: Array) -> None:
        """After a step that led off the branch: the next ones keep in front of its boundary."""
        size = float(np.abs(step).max())
        self.normal = boundary_normal(self.problem, self.pose)
        if self.normal is not None:
            along = float(self.normal @ step)
            self.normal = self.normal if along >= 0.0 else -self.normal
            self.room = SHRINK * abs(along)
            if not abs(along) > LEAST_APPROACH * float(np.linalg.norm(step)):
                self.normal = None
        self.trust = SHRINK * size if self.normal is None else size
        self.normal_is_old, self.retreats, self.blocked = False, 0, True

    def _check(self) -> bool:
        """The last point becomes the first; False, and the last one on the branch, where it is not on it."""
        points, good, bad = self.points, 0, len(self.points) - 1
        if bad == 0:
            return True
        if self._on_branch_at(points[bad]):
            (self.ramp, self.least), self.points = self._path, [points[bad]]
            return True
        while bad - good > 1:
            middle = (good + bad) // 2
            if self._on_branch_at(points[middle]):
                good, (self.ramp, self.least) = middle, self._path
            else:
                bad = middle
        self.points = [points[good]]
        self.stepped, self.steps = True, 0
        self._set_boundary(points[bad].pressures - points[good].pressures)
        return False

    def _advance(self, stop: StopRule) -> bool:
        """One step, or a shorter limit of it; False where neither helps any more."""
        problem, now, limits = self.problem, self.points[-1], self.problem.limits
        self.stepped = False
        p, r = now.pressures, now.error
        assert now.sweep.tangents is not None
        both = jacobian(problem.task, now.sweep)
        try:
            G = np.linalg.solve(now.sweep.tangents.moment[:, :3], now.sweep.tangents.moment[:, 3:])
        except np.linalg.LinAlgError:
            return False
        J = both[:, 3:] - both[:, :3] @ G
        H = J.T @ J
        H[np.diag_indices(len(p))] += 1e-13 * float(np.trace(H))
        g = J.T @ r
        if self.normal is not None and self.normal_is_old:
            normal = boundary_normal(problem, self.pose)
            self.normal = -normal if normal is not None and normal @ self.normal < 0.0 else normal
            self.normal_is_old = False
        low, high = np.maximum(limits.lower - p, -self.trust), np.minimum(limits.upper - p, self.trust)
        step = box_step(H, g, low, high)
        limited = self.normal is not None and float(self.normal @ step) > self.room
        if self.normal is not None and limited:
            step = limited_step(H, g, low, high, self.normal, self.room)
        along = 0.0 if self.normal is None else float(self.normal @ step)
        size = float(np.abs(step).max())
        gain = -float(step @ (2.0 * g + H @ step))
        if gain <= NO_GAIN * now.cost:
            self.optimal = not limited and not self.blocked
            return False
        following = np.clip(p + step, limits.lower, limits.upper)
        guess = now.base_moment - G @ step
        trial = settle(problem.rod, following, guess, problem.loads, problem.elements, STATICS_TOLERANCE)
        stable, bounded = trial is not None, self.normal is not None
        if trial is not None:
            there = self._point(following, trial.base_moment, trial.sweep)
            lower = there.cost < now.cost
            if lower and bounded:
                stable = self._on_branch_at(there)
            if lower and stable:
                self._accept(there, now.cost - there.cost, gain, size, limited, along)
                return True
        if stable:
            self.trust = SHRINK * size
            if self.trust < stop.trust:
                self.optimal = not self.blocked and self.trust < NO_TRUST
        elif not bounded:
            if self._check():
                self._set_boundary(step)
        else:
            self.blocked = True
            if min(self.room, along) > stop.room:
                self.room = SHRINK * min(self.room, along)
                self.trust = min(self.trust, size)
            else:
                self.trust = SHRINK * size
        return self.trust >= stop.trust

    def _accept(
        self, there: _BranchPoint, decrease: float, gain: float, size: float, limited: bool, along: float
    ) -> None:
        if decrease > 0.75 * gain:
            self.trust = max(self.trust, 2.0 * size)
        if decrease < 0.25 * gain:
            self.trust = 0.5 * size
        self.stepped, self.blocked = True, limited
        if self.normal is None:
            self.points.append(there)
            if len(self.points) > UNCHECKED:
                self._check()
            return
        self.points, (self.ramp, self.least), self.normal_is_old = [there], self._path, True
        if limited:
            self.room *= 2.0
        elif along < 0.0:
            self.retreats += 1
            if self.retreats > RETREATS:
                self.normal = None


def descend(problem: Problem, start: BranchPose, stop: StopRule) -> RodSolution:
    """A descent from one pose on the branch; ``start`` is inside the limits."""
    return BranchDescent(problem, start).run(stop)


def outcome_of(problem: Problem, pose: BranchPose) -> RodSolution:
    """An outcome that is a pose on the branch."""
    left = task_error(problem.task, pose.sweep)
    statics = float(np.linalg.norm(pose.sweep.moment))
    met = left <= problem.tolerance
    return RodSolution(pose.pressures, pose.base_moment, left, statics, met, met, 0, pose.sweep, not met)
