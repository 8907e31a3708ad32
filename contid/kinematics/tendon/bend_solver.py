"""The solver of bends: the native kernel of tendon robots, or its NumPy twin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from contid.kernels import load
from contid.kinematics.arc.solve import SectionSolver
from contid.kinematics.arc.task import Tuning
from contid.kinematics.array import Array
from contid.kinematics.tendon.feasible import TendonFeasible
from contid.targets import Vec3


class BendSolver(Protocol):
    """Interface of the native solver and of its NumPy twin; bends times lengths [m]."""

    def forward(self, bends: tuple[float, ...]) -> tuple[Vec3, tuple[float, ...], Vec3]:
        """Tip [m], rotation row by row, end of the first section [m]."""
        ...

    def differentiate(self, bends: tuple[float, ...], tip: Array, spin: Array, mid: Array) -> None:
        """Jacobians of tip, orientation and mid-point, into arrays ``(3, 2 n)`` the caller made."""
        ...

    def solve(
        self,
        tip: Vec3,
        direction: Vec3 | None,
        mid: Vec3 | None,
        seed: tuple[float, ...],
        rotation: tuple[float, ...] | None = None,
    ) -> tuple[tuple[float, ...], float, bool, tuple[int, ...], int, int]:
        """Bends, residual [m], converged, numbers of the binding limits, iterations, starts."""
        ...

    def avoid(
        self,
        obstacles: Sequence[Sequence[float]],
        radius: float,
        margin: float,
        from_: float,
        zone: float,
        force: float,
    ) -> None:
        """Keep redundant bends away from obstacles; see `contid.kinematics.arc.avoid.Avoid`."""
        ...


class _Twin:
    """The NumPy solver of arcs with the native kernel's results."""

    def __init__(self, feasible: TendonFeasible, tuning: Tuning) -> None:
        self._solver = SectionSolver(feasible, tuning)
        self.forward = self._solver.forward
        self.differentiate = self._solver.differentiate
        self.avoid = self._solver.avoid

    def solve(
        self,
        tip: Vec3,
        direction: Vec3 | None,
        mid: Vec3 | None,
        seed: tuple[float, ...],
        rotation: tuple[float, ...] | None = None,
    ) -> tuple[tuple[float, ...], float, bool, tuple[int, ...], int, int]:
        """See `BendSolver`."""
        bends, residual_m, converged, bits, iterations, starts = self._solver.solve(
            tip, direction, mid, seed, rotation
        )
        binding = tuple(k for k in range(bits.bit_length()) if bits >> k & 1)
        return bends, residual_m, converged, binding, iterations, starts


def build_bend_solver(feasible: TendonFeasible) -> BendSolver:
    """The native solver where it is built and not switched off, its NumPy twin otherwise."""
    sections = feasible.sections
    # Where a limit of tension binds next to the edge of the reach, homing ends up to 3e-6 m from its minimum.
    tuning = Tuning(ell_m=ell_of(feasible), still_m=1e-5, still_error_m=1e-8)
    kernel = load("tendon3" if sections.count == 3 else "tendon")  # a build of its own for three
    if kernel is None:
        return _Twin(feasible, tuning)
    solver: BendSolver = kernel.SectionSolver(
        sections.backbone_m,
        sections.rigid_m,
        sections.offset_m,
        feasible.bend_max_rad,
        feasible.normals.ravel().tolist(),
        feasible.offsets.tolist(),
        tuning,
    )
    return solver


def ell_of(feasible: TendonFeasible) -> float:
    """Length that a radian of direction counts as [m]: a fifth of the robot."""
    return 0.2 * (sum(feasible.sections.backbone_m) + sum(feasible.sections.rigid_m))
