"""The model of tri-rack arms and of tube arms such as the CBHA: sections, limits and their solver."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from contid.kernels import load
from contid.kinematics.any_target import any_target
from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.sections import Sections, backbone
from contid.kinematics.arc.solver import FORCE, ZONE, Solver, Tuning, nearest_note, tuning_for
from contid.kinematics.array import Array
from contid.robot_file.sections import SectionRobot
from contid.targets import REACH, ZERO3, Actuation, Pose, Solution, Target, Vec3
from contid.units import LIMIT_TOLERANCE_M, m_to_mm


def feasible_of(robot: SectionRobot) -> Feasible:
    """Geometry and limits of a robot description."""
    angles = tuple((math.radians(a), math.radians(b), math.radians(c)) for a, b, c in robot.tube_angles_deg)
    sections = Sections(robot.radius_m, angles, robot.rigid_m)
    return Feasible(sections, robot.lower[::3], robot.upper[::3], robot.rack_m, robot.curvature_max_per_m)


def build_solver(feasible: Feasible, tuning: Tuning | None = None) -> Solver:
    """The compiled solver of a chain.

    Raises:
        KernelMissingError: It is not compiled in this installation.
    """
    kernel = load("arc")
    solver: Solver = kernel.SectionSolver(
        feasible.sections.radius_m,
        feasible.sections.to_arc.ravel().tolist(),
        feasible.sections.to_lengths.ravel().tolist(),
        feasible.sections.rigid_m,
        feasible.lower,
        feasible.upper,
        feasible.home.tolist(),
        feasible.rack_m,
        feasible.curvature_max,
        tuning or tuning_for(feasible),
    )
    return solver


def shared_lengths(feasible: Feasible) -> Any:
    """The compiled limits that lengths of a chain share: three racks where they have a budget, then bends."""
    sections = feasible.sections
    return load("limiter").SharedLengths(
        sections.radius_m, sections.to_arc.ravel().tolist(), feasible.rack_m, feasible.curvature_max
    )


class SectionModel:
    """Forward and inverse kinematics of a chain of constant-curvature sections."""

    dimension = 3

    def __init__(self, robot: SectionRobot) -> None:
        self.axis_names = robot.axis_names
        self.lower = robot.lower
        self.upper = robot.upper
        self.feasible = feasible_of(robot)
        self.sections = self.feasible.sections
        self.tuning = tuning_for(self.feasible)
        self.solver = build_solver(self.feasible, self.tuning)
        #: Names in `Solution.limited_by`, in the order of its bits.
        self.limit_names = (*self.feasible.names, REACH)
        #: Some limits are shared by several axes. They are convex: a straight line between two actuations
        #: inside them stays inside.
        budget = self.sections.count > 1 and self.feasible.rack_m < math.inf
        self._rest_lengths = [length.rest_m for length in robot.section_lengths]
        self.straight_approach = budget or self.feasible.curvature_max < math.inf
        self.shared = shared_lengths(self.feasible) if self.straight_approach else None

    def avoid(
        self, obstacles: Sequence[Sequence[float]], radius_m: float, margin_m: float, from_m: float
    ) -> None:
        """Lead redundant axes around obstacles, of which the body keeps a margin where that can be.

        Args:
            obstacles: rows of `contid_clearance.obstacles.Obstacle.packed` in the base frame.
            radius_m: radius of the body [m].
            margin_m: least distance of surfaces [m].
            from_m: arc length where the body begins [m].
        """
        ell_m = self.tuning.ell_m
        self.solver.avoid(obstacles, radius_m, margin_m, from_m, ZONE * ell_m, FORCE * ell_m)

    def forward(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Pose:
        """Tip, orientation and mid-point for lengths [m]; a load does not bend the arc in this model."""
        found = self.solver.forward(actuation)
        rotation = found.rotation
        return Pose(found.tip, rotation, (rotation[2], rotation[5], rotation[8]), found.mid)

    def jacobian(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Derivative of the tip by the lengths, shape (3, 3 n); regular on the straight arm."""
        tip, spin, mid = np.empty((3, 3, len(self.axis_names)))
        self.solver.differentiate(actuation, tip, spin, mid)
        return tip

    def shape(self, actuation: Actuation, points: int, load_n: Vec3 = ZERO3) -> Array:
        """Backbone at equal arc length, rigid pieces included, shape (points, 3) [m]."""
        return backbone(self.sections, actuation, points)

    def arcs(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Bends and length of every section (`contid.kinematics.model.Bending`)."""
        return self.sections.arcs(actuation)

    def of_arcs(self, arcs: Sequence[float], seed: Actuation, load_n: Vec3 = ZERO3) -> Actuation:
        """Lengths that have these bends (`contid.kinematics.model.Bending`).

        A length that is left open is the one nearest to that of the rest pose with which the tubes of the
        section are in their interval whatever the azimuth, if there is one, and its bend radius is kept. So
        a bend that turns around does not change it.
        """
        rows = np.reshape(arcs, (-1, 3)).copy()
        least, most, per_length = self.feasible.low[::3], self.feasible.high[::3], self.sections.to_lengths
        for k in np.flatnonzero(rows[:, 2] == 0.0).tolist():
            bend = math.hypot(*rows[k, :2])
            swing, apart = self.sections.radius_m[k] * bend, per_length[k, :, :2] @ rows[k, :2]
            shortest = max(least[k] + swing, bend / self.feasible.curvature_max)
            length = min(max(self._rest_lengths[k], shortest), most[k] - swing)
            rows[k, 2] = min(max(length, least[k] - apart.min()), most[k] - apart.max())
        found: list[float] = np.einsum("nij,nj->ni", per_length, rows).ravel().tolist()
        return tuple(found)

    @any_target
    def inverse(self, target: Target, seed: Actuation) -> Solution:
        """Lengths inside every limit for a tip, or with its direction, its frame or a mid-point.

        A redundant arm gets the answer closest to the middle of its ranges. A direction enters the residual
        times `Tuning.ell_m`, a fifth of the arm.
        """
        return self._solved(target, seed)

    def follows(self, load_n: Vec3) -> bool:
        """See `contid.kinematics.model.Following`."""
        return True

    @any_target
    def follow(self, target: Target, answer: Actuation) -> Solution:
        """See `contid.kinematics.model.Following`."""
        return self._solved(target, answer, follows=True)

    def _solved(self, target: Target, seed: Actuation, follows: bool = False) -> Solution:
        if target.actuation is not None:
            return self._clamped(target.actuation)
        if target.tip_m is None:
            raise ValueError("an arm of sections takes a tip position or lengths")
        asked = (target.tip_m, target.direction, target.mid_m, seed, target.rotation)
        found = self.solver.solve(*asked, follows)
        limits, left_m = self.feasible.named(found.binding), found.residual_m
        if found.converged:
            return Solution(found.lengths, left_m, True, limits, found.iterations)
        return Solution(
            found.lengths, left_m, False, limits or (REACH,), found.iterations, nearest_note(left_m)
        )

    def _clamped(self, requested: Actuation) -> Solution:
        excess = self.feasible.excess(np.array(requested))
        if not np.any(excess > 0.0):
            return Solution(requested, 0.0, True)
        lengths = self.feasible.pulled(requested)
        actuation = tuple(lengths.tolist())
        if float(np.max(excess)) <= LIMIT_TOLERANCE_M:
            return Solution(actuation, 0.0, True)
        residual_m = math.dist(self.forward(actuation).tip_m, self.forward(requested).tip_m)
        off_m = float(np.abs(lengths - np.array(requested)).max())
        note = f"lengths moved by up to {m_to_mm(off_m):.6g} mm to stay inside the limits"
        limits = self.feasible.named(self.feasible.binding(lengths))
        return Solution(actuation, residual_m, False, limits, 0, note)
