"""The model of tendon robots under loads: the backbone as a rod, with weight and a force on the tip.

Backwards, the target of the arcs (`TendonModel`) is shifted until the rod meets the real one, by the method
of C. G. Broyden (Math. Comp. 19, 1965), which needs no derivative of the shift; it begins with that of the
seed, else with none. Sections are tightened until the tensions of the rod are at or above the floor. Where
the rod buckles from every equilibrium found, the answer is the seed.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace
from typing import Final

import numpy as np

from contid.kinematics.any_target import any_target
from contid.kinematics.arc.solver import nearest_note
from contid.kinematics.array import Array, pseudo_inverse, size_of, step_lengths
from contid.kinematics.tendon.geometry import TendonGeometry
from contid.kinematics.tendon.model import TendonModel
from contid.kinematics.tendon.taut import TautPulls
from contid.kinematics.tendon.tension import TendonStatics
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import ZERO3, Actuation, Pose, Solution, Target, Vec3, vec3
from contid.units import MM_PER_M
from contid_tendons.rod import TendonEquilibrium, TendonRod

#: G J of a round rod: E I / (1 + Poisson's ratio).
_TORSION_SHARE: Final = 1.0 / 1.3
#: Rounds of Broyden's method at most: from no shift, and before that from the seed, as in a tick.
_ROUNDS: Final = 40
_TRACKED: Final = 8
#: Residual to which answers are corrected, and one that still counts as met [m].
_EXACT_M: Final = 1e-8
_MET_M: Final = 1e-7
#: A tension below the floor by less than this counts as at the floor [N].
_TENSION_N: Final = 1e-6
#: Length that a radian of direction counts as [m].
_ELL_M: Final = 0.1
#: Steps in which the load grows where the equilibrium is not found at once.
_STEPS: Final = 5
#: Limit of an answer whose rod buckles.
_STABILITY: Final = "stability"
_BUCKLES: Final = "every equilibrium found is unstable, the rod buckles; holding the last command"
#: How much farther off than it is such an answer counts [m]: more than any robot's length.
_BUCKLED_M: Final = 1e3
#: Pieces of each element in a shape.
_PARTS: Final = 8


class LoadedTendonModel(TendonModel):
    """A tendon robot with ``rod`` in its file.

    Attributes:
        rod: the backbone.
        statics, taut: never None, because ``rod`` needs ``tension``.
    """

    statics: TendonStatics
    taut: TautPulls

    def __init__(self, robot: TendonRobot) -> None:
        super().__init__(robot)
        # The correction of the tip is that of the rod; the arcs that begin the search have none.
        self._rod_correction, self._correction = self._correction, None
        self.rod = rod_of(robot, self.geometry, self.statics)
        self._rounds = _ROUNDS

    def for_ticks(self) -> LoadedTendonModel:
        """The same model with a short second search: a target out of reach costs a third of the time."""
        short = copy(self)
        short._rounds = _TRACKED
        return short

    def equilibrium(
        self,
        actuation: Actuation | Array,
        load_n: Vec3 = ZERO3,
        near: TendonEquilibrium | None = None,
        derivatives: bool = True,
    ) -> TendonEquilibrium:
        """The rod for pulls [m] and a force on the tip [N] in the base frame.

        Args:
            actuation: pulls [m].
            load_n: force on the tip [N].
            near: an equilibrium to start from; arcs without.
            derivatives: as for `TendonRod.solve`.

        Raises:
            ArithmeticError: none was found, as for a load far beyond the robot.
        """
        pulls = np.asarray(actuation, dtype=np.float64)
        start = self.rod.even(self.bends(pulls)) if near is None else near.strain
        try:
            return self.rod.solve(pulls, load_n, start, derivatives=derivatives)
        except ArithmeticError:
            for step in range(1, _STEPS):  # led there by a growing load
                x, y, z = (step / _STEPS * f for f in load_n)
                start = self.rod.solve(pulls, (x, y, z), start).strain
            return self.rod.solve(pulls, load_n, start)

    def forward(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Pose:
        """Tip, orientation and end of the first section for pulls [m]."""
        return self._posed(self.equilibrium(actuation, load_n, derivatives=False), actuation)

    def jacobian(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Derivative of the tip by the pulls, shape (3, tendons)."""
        jacobian = self.equilibrium(actuation, load_n).jacobian
        if self._rod_correction is None:
            return jacobian
        return jacobian + self._rod_correction.slope(np.asarray(actuation))

    def compliance(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Derivative of the tip by a force on it [m/N], shape (3, 3)."""
        return self.equilibrium(actuation, load_n).compliance

    def shape(self, actuation: Actuation, points: int, load_n: Vec3 = ZERO3) -> Array:
        """Backbone and rigid pieces at equal arc length, base offset first, shape (points, 3) [m]."""
        curve = self.rod.curve(self.equilibrium(actuation, load_n, derivatives=False).strain, _PARTS)
        lengths = np.concatenate(([0.0], np.cumsum(step_lengths(curve))))
        even_lengths = np.linspace(0.0, lengths[-1], points)
        shape = np.stack([np.interp(even_lengths, lengths, column) for column in curve.T], axis=1)
        if self._rod_correction is not None:
            shape[-1] += self._rod_correction.at(np.asarray(actuation))
        return shape

    def tensions(self, actuation: Actuation) -> Array:
        """Tensions ``(tendons,)`` [N] of pulls [m] without a force on the tip."""
        return self.equilibrium(actuation, derivatives=False).tensions_n

    @any_target
    def inverse(self, target: Target, seed: Actuation) -> Solution:
        """Pulls whose rod, under its weight and the target's load, meets the target; see the module."""
        if target.actuation is not None or target.tip_m is None:
            return super().inverse(target, seed)
        goal = _task_rows(target.tip_m, target.direction, target.mid_m)
        unknown, rod = self._begin(goal, target, seed)
        tracked, off = self._search(goal, target, seed, unknown, rod, _TRACKED)
        if tracked.converged:
            return tracked
        cold = np.concatenate((goal, np.zeros(self.geometry.count)))
        found, left = self._search(goal, target, seed, cold, None, self._rounds)
        if not found.converged and off < left:
            found = tracked
        if found.converged:
            return found
        if _STABILITY in found.limited_by:
            held = tuple(np.clip(seed, self.lower, self.upper).tolist())
            return replace(found, actuation=held, residual_m=math.inf, note=_BUCKLES)
        return replace(found, note=nearest_note(found.residual_m))

    def _search(
        self,
        goal: Array,
        target: Target,
        seed: Actuation,
        unknown: Array,
        rod: TendonEquilibrium | None,
        rounds: int,
    ) -> tuple[Solution, float]:
        """The best answer in some rounds, and how far it is off [m], tensions below the floor included.

        One whose rod buckles counts as farther off than any other.

        Args:
            goal: rows of the target [m].
            target: target with its load.
            seed: a guess of the arcs.
            unknown: the target of the arcs, and the tightness of each section as a stretch [m].
            rod: an equilibrium to start from.
            rounds: greatest number of rounds.
        """
        count, n_per_m = len(goal), self.statics.tendon_n_per_m
        slope = np.eye(len(unknown))
        before: tuple[Array, Array] | None = None
        best: tuple[float, Solution] | None = None
        for turn in range(1, rounds + 1):
            arcs = super().inverse(_with_rows(target, unknown[:count]), seed)
            tight = unknown[count:][self.geometry.section_of] * self.statics.slack_free
            pulls = np.clip(np.array(arcs.actuation) + tight, self.lower, self.upper)
            rod = self.equilibrium(pulls, target.load_n, rod, derivatives=False)
            pose = self._posed(rod, pulls)
            error = goal - self._task_of(pose, target)
            size = size_of(error)
            lacks, over = self._missing_tension(rod), self._over_the_limit(rod)
            unstable = () if rod.stable else (_STABILITY,)
            limits = tuple(dict.fromkeys(unstable + over + arcs.limited_by))
            found = Solution(tuple(pulls.tolist()), size, False, limits, turn)
            judged = size + float(np.maximum(lacks, 0.0).sum()) / float(n_per_m.min())
            if unstable:
                judged += _BUCKLED_M
            if best is None or judged < best[0]:
                best = judged, found
            met = size <= (_EXACT_M if 2 * turn < rounds else _MET_M)
            if met and not np.any(lacks > _TENSION_N):
                if over or unstable:
                    break
                return replace(found, converged=True), judged
            binds = (lacks > 0.0) | (unknown[count:] > 0.0)
            left = np.concatenate((error, np.where(binds, lacks / n_per_m.max(), 0.0)))
            if before is not None:
                moved, changed = unknown - before[0], before[1] - left
                slope += np.outer(changed - slope @ moved, moved) / max(float(moved @ moved), 1e-300)
            before = unknown.copy(), left
            unknown = unknown + pseudo_inverse(slope, 1e-6) @ left
            unknown[count:] = np.maximum(unknown[count:], 0.0)
        assert best is not None
        return best[1], best[0]

    def _begin(self, goal: Array, target: Target, seed: Actuation) -> tuple[Array, TendonEquilibrium | None]:
        """Unknowns to begin with: how arcs and rod differ in the seed, and its tightness; the rod there."""
        none = np.zeros(self.geometry.count)
        try:
            rod = self.equilibrium(seed, target.load_n, derivatives=False)
        except ArithmeticError:
            return np.concatenate((goal, none)), None
        arcs = super().forward(seed)
        shift = self._task_of(arcs, target) - self._task_of(self._posed(rod, seed), target)
        if not size_of(shift) < sum(self.feasible.sections.backbone_m):  # a seed out of bounds
            return np.concatenate((goal, none)), rod
        # The tendons of a section are equally stiff.
        n_per_m = self.statics.tendon_n_per_m[self.geometry.first_of]
        stretch = self.taut.tightness(np.asarray(seed)) / n_per_m
        return np.concatenate((goal + shift, np.maximum(stretch, 0.0))), rod

    @staticmethod
    def _task_of(pose: Pose, target: Target) -> Array:
        """Rows (`_task_rows`) of a pose, of the kinds that a target has [m]."""
        direction = None if target.direction is None else pose.direction
        return _task_rows(pose.tip_m, direction, None if target.mid_m is None else pose.mid_m)

    def _posed(self, rod: TendonEquilibrium, pulls: Actuation | Array) -> Pose:
        """Pose of the rod for pulls [m], its tip corrected."""
        tip = rod.tip_m
        if self._rod_correction is not None:
            tip = tip + self._rod_correction.at(np.asarray(pulls))
        rotation = tuple(rod.rotation.ravel().tolist())
        direction, mid = (vec3(row.tolist()) for row in (rod.rotation[:, 2], rod.ends_m[0]))
        return Pose(vec3(tip.tolist()), rotation, direction, mid, rod.stable)

    def _missing_tension(self, rod: TendonEquilibrium) -> Array:
        """Tension that each section lacks to the floor [N]; negative where it has more."""
        lacks = (self.statics.floor_n - rod.tensions_n) / self.statics.slack_free
        return np.asarray(np.maximum.reduceat(lacks, self.geometry.first_of))

    def _over_the_limit(self, rod: TendonEquilibrium) -> tuple[str, ...]:
        """Tendons over the largest tension."""
        over = rod.tensions_n > self.statics.limit_n + _TENSION_N
        return tuple(f"{name}.tension" for name, yes in zip(self.axis_names, over, strict=True) if yes)


def rod_of(robot: TendonRobot, geometry: TendonGeometry, statics: TendonStatics) -> TendonRod:
    """The rod of a robot description."""
    assert robot.rod is not None
    assert robot.tension is not None
    square = MM_PER_M * MM_PER_M
    bending = [value / square for value in robot.per_section(robot.tension.bending_n_mm2)]
    torsion = [_TORSION_SHARE * value for value in bending]
    if robot.rod.torsion_n_mm2 is not None:
        torsion = [value / square for value in robot.per_section(robot.rod.torsion_n_mm2)]
    stretch = [math.inf] * geometry.count
    if robot.rod.stretch_n is not None:
        stretch = list(robot.per_section(robot.rod.stretch_n))
    weight = np.outer(robot.per_section(robot.rod.weight_n_per_m), robot.down_in_base)
    return TendonRod(
        geometry, bending, torsion, stretch, statics.tendon_n_per_m, statics.rest_n, weight,
        elements=robot.rod.elements,
    )  # fmt: skip


def _task_rows(tip: Vec3, direction: Vec3 | None, mid: Vec3 | None) -> Array:
    """Tip, direction times `_ELL_M` and mid-point, those that are given one after the other [m]."""
    rows = [np.array(tip)]
    if direction is not None:
        rows.append(_ELL_M * np.array(direction) / math.hypot(*direction))
    if mid is not None:
        rows.append(np.array(mid))
    return np.concatenate(rows)


def _with_rows(target: Target, rows_m: Array) -> Target:
    """The target of the same kinds with other rows (`_task_rows`), without load."""
    rows = rows_m.reshape(-1, 3)
    direction = mid = None
    if target.direction is not None:
        direction = vec3((rows[1] / size_of(rows[1])).tolist())
    if target.mid_m is not None:
        mid = vec3(rows[-1].tolist())
    return replace(target, tip_m=vec3(rows[0].tolist()), direction=direction, mid_m=mid, load_n=ZERO3)
