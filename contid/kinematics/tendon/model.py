"""The model of tendon robots: pulls of tendons to a tip by sections of constant curvature, and back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import Final

import numpy as np

from contid.kinematics.any_target import any_target
from contid.kinematics.arc.sections import backbone
from contid.kinematics.arc.solver import FORCE, ZONE, nearest_note
from contid.kinematics.array import Array, size_of
from contid.kinematics.tendon.capstan import CapstanLead
from contid.kinematics.tendon.described import bend_max_of, bends_by_pulls, geometry_of, statics_of
from contid.kinematics.tendon.feasible import build_bend_solver, ell_of, limits_of
from contid.kinematics.tendon.geometry import BendSections
from contid.kinematics.tendon.residual import TipCorrection
from contid.kinematics.tendon.taut import PullLimits, TautPulls
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import ZERO3, Actuation, Pose, Solution, Target, Vec3
from contid.units import LIMIT_TOLERANCE_M, m_to_mm

#: The limit of a target that no bend of the robot meets: sections keep their length.
_LENGTH: Final = "length"
#: Rounds of the fixed point of a corrected tip, its accuracy, and the error of a target that is met [m].
_ROUNDS: Final = 40
_SETTLED_M: Final = 1e-10
_MET_M: Final = 1e-6


class TendonModel:
    """Forward and inverse kinematics of a tendon robot; `TendonStatics` has the tensions.

    A target's ``rotation`` is its tip frame: six numbers with the tip, for three sections or more.
    """

    dimension = 3

    def __init__(self, robot: TendonRobot) -> None:
        self.axis_names = robot.axis_names
        self.lower = robot.lower
        self.upper = robot.upper
        self.geometry = geometry_of(robot)
        self.statics = statics_of(robot, self.geometry)
        self.feasible = limits_of(
            self.geometry, self.axis_names, self.lower, self.upper, bend_max_of(robot), self.statics
        )
        self.solver = build_bend_solver(self.feasible)
        self._lengths = np.repeat(self.feasible.sections.backbone_m, 2)
        self._base_m = self.geometry.base_offset_m
        #: Variables of the solver [m] by pulls [m].
        self._by_pulls: Array = self._lengths[:, None] * bends_by_pulls(self.geometry, self.statics)
        self._limits = PullLimits(self.lower, self.upper, self.statics, self.feasible, self._by_pulls)
        #: Pulls as bends and tightness; None where tensions are not bounded.
        self.taut = None if self.statics is None else TautPulls(self._limits, self.statics)
        #: Lead of the friction in the bends; None without.
        self.capstan: CapstanLead | None = None
        if robot.capstan is not None and self.statics is not None:
            self.capstan = CapstanLead(self.statics, robot.capstan)
        self._correction: TipCorrection | None = None
        if robot.residual is not None and self.statics is not None:
            self._correction = TipCorrection.of(robot.residual, self.statics)

    def avoid(
        self, obstacles: Sequence[Sequence[float]], radius_m: float, margin_m: float, from_m: float
    ) -> None:
        """Lead redundant bends around obstacles: see `SectionModel.avoid`."""
        rows = [(*row[:3], row[3] - self._base_m, *row[4:]) for row in obstacles]
        ell_m, begin_m = ell_of(self.feasible), max(from_m - self._base_m, 0.0)
        self.solver.avoid(rows, radius_m, margin_m, begin_m, ZONE * ell_m, FORCE * ell_m)

    def forward(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Pose:
        """Tip, orientation and end of the first section for pulls [m]; a load does not bend this model."""
        found = self.solver.forward(tuple((self._by_pulls @ actuation).tolist()))
        tip, rotation, mid, lift = found.tip, found.rotation, found.mid, self._base_m
        if self._correction is not None:
            tip = _moved(tip, self._correction.at(np.asarray(actuation)))
        return Pose(
            (tip[0], tip[1], tip[2] + lift),
            rotation,
            (rotation[2], rotation[5], rotation[8]),
            (mid[0], mid[1], mid[2] + lift),
        )

    def jacobian(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Derivative of the tip by the pulls, shape (3, tendons); exact, also for the straight robot."""
        tip, spin, mid = np.empty((3, 3, len(self._lengths)))
        self.solver.differentiate(tuple((self._by_pulls @ actuation).tolist()), tip, spin, mid)
        jacobian: Array = tip @ self._by_pulls
        if self._correction is not None:
            jacobian = jacobian + self._correction.slope(np.asarray(actuation))
        return jacobian

    def shape(self, actuation: Actuation, points: int, load_n: Vec3 = ZERO3) -> Array:
        """Backbone and rigid pieces at equal arc length, base offset first, shape (points, 3) [m]."""
        x = self._by_pulls @ actuation
        sections = self.feasible.sections
        if self._base_m:  # a section that never bends
            sections = BendSections((self._base_m, *sections.backbone_m), (0.0, *sections.rigid_m))
            x = np.concatenate(([0.0, 0.0], x))
        curve = backbone(sections, x, points)
        curve[-1] = self.forward(actuation).tip_m  # a tip offset may lead aside
        return curve

    def bends(self, actuation: Actuation | Array) -> Array:
        """Bends ``(2 sections,)`` [rad] of pulls [m]."""
        bends: Array = self._by_pulls @ np.asarray(actuation) / self._lengths
        return bends

    def arcs(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Bends and length of every section (`contid.kinematics.model.Bending`)."""
        return np.column_stack((self.bends(actuation).reshape(-1, 2), self.feasible.sections.backbone_m))

    def of_arcs(self, arcs: Sequence[float], seed: Actuation, load_n: Vec3 = ZERO3) -> Actuation:
        """Pulls that have these bends (`contid.kinematics.model.Bending`); sections keep their length."""
        return tuple(self._pulls_of(np.reshape(arcs, (-1, 3))[:, :2].ravel()).tolist())

    def tendon_pulls(self, actuation: Actuation | Array) -> Array:
        """Pulls ``(tendons,)`` [m] of an actuation: those themselves, where every tendon has a motor."""
        return np.asarray(actuation, dtype=np.float64)

    def tensions(self, actuation: Actuation) -> Array | None:
        """Tensions ``(tendons,)`` [N] of an actuation [m]; None where the robot file has no ``tension``."""
        return None if self.statics is None else self.statics.tensions(self.tendon_pulls(actuation))

    @any_target
    def inverse(self, target: Target, seed: Actuation) -> Solution:
        """Pulls inside every limit of travel and tension for a tip with its direction, frame or mid-point.

        Of the bends that meet a target the ones nearest to the straight robot; of the pulls for these bends
        the ones whose least tension in every section is the floor. A direction enters the residual times a
        fifth of the robot's length.
        """
        if target.actuation is not None:
            return self._clamped(target.actuation)
        if target.tip_m is None:
            raise ValueError("a tendon robot takes a tip position or pulls")
        lift = self._base_m
        if self._correction is not None:
            return self._corrected(target, seed, self._correction)
        tip, mid = target.tip_m, target.mid_m
        if lift:
            tip = (tip[0], tip[1], tip[2] - lift)
            mid = None if mid is None else (mid[0], mid[1], mid[2] - lift)
        start = tuple((self._by_pulls @ seed).tolist())
        found = self.solver.solve(tip, target.direction, mid, start, target.rotation)
        pulls, limits = (
            self._pulls(np.array(found.lengths) / self._lengths),
            self.feasible.named(found.binding),
        )
        if found.converged:
            return Solution(pulls, found.residual_m, True, limits, found.iterations)
        note = nearest_note(found.residual_m)
        return Solution(pulls, found.residual_m, False, limits or (_LENGTH,), found.iterations, note)

    def _corrected(self, target: Target, seed: Actuation, correction: TipCorrection) -> Solution:
        """The answer whose correction moves the tip onto the target: a fixed point, begun at the seed."""
        assert target.tip_m is not None
        plain = copy(self)
        plain._correction = None
        shift = correction.at(np.asarray(seed))
        if not np.all(np.isfinite(shift)):
            shift = np.zeros(3)
        iterations = 0
        for _ in range(_ROUNDS):
            plain_solution = plain.inverse(replace(target, tip_m=_moved(target.tip_m, -shift)), seed)
            iterations += plain_solution.iterations
            next_shift = correction.at(np.asarray(plain_solution.actuation))
            change_m = size_of(next_shift - shift)
            if change_m <= _SETTLED_M or not np.isfinite(change_m):
                break
            shift, seed = next_shift, plain_solution.actuation
        residual_m = plain_solution.residual_m + change_m
        if plain_solution.converged and residual_m <= _MET_M:
            return replace(plain_solution, residual_m=residual_m, iterations=iterations)
        limits, note = plain_solution.limited_by or (_LENGTH,), nearest_note(residual_m)
        return replace(
            plain_solution,
            residual_m=residual_m,
            converged=False,
            limited_by=limits,
            iterations=iterations,
            note=note,
        )

    def _pulls(self, bends: Array) -> Actuation:
        """Pulls of bends [rad], within the travel to the last bit."""
        return tuple(np.clip(self._pulls_of(bends), self.lower, self.upper).tolist())

    def _pulls_of(self, bends: Array) -> Array:
        return self.geometry.pulls(bends) if self.statics is None else self.statics.pulls(bends)

    def excess(self, actuation: Actuation) -> Array:
        """By how much limits of travel, tension and bends are exceeded by pulls [m], negative inside."""
        return self._limits.excess(actuation)

    @property
    def limit_names(self) -> tuple[str, ...]:
        """Names in the order of `excess`."""
        kinds = ("min", "max") if self.statics is None else ("min", "max", "slack", "tension")
        tendons = tuple(f"{name}.{kind}" for kind in kinds for name in self.axis_names)
        return (*tendons, *self.feasible.names[self.feasible.flat :])

    def _clamped(self, requested: Actuation) -> Solution:
        """The pulls themselves where every tendon stays taut and inside its limits; else near ones."""
        excess = self.excess(requested)
        if np.all(excess <= LIMIT_TOLERANCE_M):
            return Solution(tuple(np.clip(requested, self.lower, self.upper).tolist()), 0.0, True)
        limits = tuple(name for name, over in zip(self.limit_names, excess, strict=True) if over > 0.0)
        pulls = self._pulls(self.feasible.pulled(self._by_pulls @ np.array(requested)) / self._lengths)
        residual_m = math.dist(self.forward(pulls).tip_m, self.forward(requested).tip_m)
        off_m = max(abs(a - w) for a, w in zip(pulls, requested, strict=True))
        note = f"pulls moved by up to {m_to_mm(off_m):.6g} mm to keep every tendon taut and inside the limits"
        return Solution(pulls, residual_m, False, limits, 0, note)


def _moved(tip: Vec3, by: Array) -> Vec3:
    x, y, z = by.tolist()
    return tip[0] + x, tip[1] + y, tip[2] + z
