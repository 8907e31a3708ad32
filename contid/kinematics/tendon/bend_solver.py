"""The solver of bends: the kernel of tendon robots."""

from __future__ import annotations

from contid.kernels import load
from contid.kinematics.arc.solver import Solver
from contid.kinematics.arc.tuning import Tuning
from contid.kinematics.tendon.feasible import TendonFeasible


def build_bend_solver(feasible: TendonFeasible) -> Solver:
    """The compiled solver of a robot.

    Raises:
        KernelMissingError: It is not compiled in this installation.
    """
    sections = feasible.sections
    # Where a limit of tension binds next to the edge of the reach, homing ends up to 3e-6 m from its minimum.
    tuning = Tuning(ell_m=ell_of(feasible), still_m=1e-5, still_error_m=1e-8)
    kernel = load("tendon")
    solver: Solver = kernel.SectionSolver(
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
