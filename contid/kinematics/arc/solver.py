"""What solves the inverse kinematics of a chain of arcs: the interface of the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.array import Array
from contid.targets import Actuation, Vec3
from contid.units import m_to_mm


@dataclass(frozen=True, slots=True)
class Tuning:
    """Numbers of the solver.

    Attributes:
        ell_m: length that scales damping and direction rows [m].
        tolerance_m: error at which a target is met [m].
        home_tolerance_m: step at which the redundancy counts as settled [m].
        weight: w, least damping, and bound of the multipliers where the task is singular.
        near: homing starts below ``near * ell_m`` of error.
        home_steps: maximum number of homing steps; twice as many near obstacles.
        contraction: where homing steps shrink less than by this factor, their metric gets the curvature.
        slow: a damped step that leaves more than this share of the error ends the approach.
        iterations: maximum number of damped steps per start.
        settling: maximum number of Newton steps per start, for a target that is not met.
        starts: maximum number of starts after the seed, for a target that is not met.
        agreeing: number of starts ending at the best answer that ends the search for a target beyond the
            length of the arm; within its length every start is tried.
        tracking: a descent from the seed that moves less than ``tracking * ell_m`` without meeting its target
            follows a bounded optimum from tick to tick: then at most ``agreeing`` starts, to stay in time.
        still_m: a seed that meets its target within ``still_error_m`` [m] is kept where the first step is
            shorter [m]: an answer solved again from itself does not move.
        still_error_m: see ``still_m``.
    """

    ell_m: float
    tolerance_m: float = 1e-6
    home_tolerance_m: float = 1e-8
    weight: float = 1e-8
    near: float = 0.3
    home_steps: int = 60
    contraction: float = 0.3
    slow: float = 0.95
    iterations: int = 60
    settling: int = 80
    starts: int = 32
    agreeing: int = 3
    tracking: float = 0.1
    still_m: float = 1e-8
    still_error_m: float = 1e-10


def tuning_for(feasible: Feasible) -> Tuning:
    """Numbers scaled to the size of the robot: ``ell`` is a fifth of the arm in its home posture."""
    return Tuning(ell_m=0.2 * (float(feasible.home.sum()) / 3.0 + sum(feasible.sections.rigid_m)))


#: Zone and force of the potential of obstacles by the length that scales damping (`Tuning.ell_m`). A narrower
#: zone or a smaller force loses answers between obstacles, larger ones cost time: benchmarks/obstacles.py.
ZONE: Final = 0.2
FORCE: Final = 0.5


class SectionFrames(NamedTuple):
    """Where a chain ends: tip [m], rotation row by row, end of the first section [m]."""

    tip: Vec3
    rotation: tuple[float, ...]
    mid: Vec3


class SectionSolution(NamedTuple):
    """Variables inside every limit, and the error that is left.

    Attributes:
        lengths: lengths of every tube or rack, or bends times lengths of sections (`BendSections`) [m].
        residual_m: norm of the task error [m].
        converged: it is within the tolerance.
        binding: bit mask of the limits that bind.
        iterations: damped steps in all.
        starts: descents that were run; 0 for a closed form.
    """

    lengths: Actuation
    residual_m: float
    converged: bool
    binding: int
    iterations: int
    starts: int


class Solver(Protocol):
    """See the module; lengths are the variables of the chain, ``N`` in all [m]."""

    def forward(self, lengths: Actuation) -> SectionFrames:
        """Where the chain ends."""

    def differentiate(self, lengths: Actuation, tip: Array, spin: Array, mid: Array) -> None:
        """Write the Jacobians of tip, orientation and mid-point into arrays ``(3, N)`` of the caller."""

    def solve(
        self,
        tip: Vec3,
        direction: Vec3 | None,
        mid: Vec3 | None,
        seed: Actuation,
        rotation: tuple[float, ...] | None = None,
        follows: bool = False,
    ) -> SectionSolution:
        """The best bounded lengths for a tip [m] and maybe its unit tangent, its frame or the mid-point [m].

        Continuous from ``seed`` where the target allows it. With ``follows`` a target out of reach is not
        searched for where the error is stationary within `Tuning.tracking` of the seed.
        """

    def avoid(
        self,
        obstacles: Sequence[Sequence[float]],
        radius: float,
        margin: float,
        from_: float,
        zone: float,
        force: float,
    ) -> None:
        """Keep redundant axes away from obstacles; none switches that off.

        Args:
            obstacles: rows of `contid_clearance.obstacles.Obstacle.packed` in the base frame.
            radius: radius of the body [m].
            margin: least distance of surfaces [m].
            from_: arc length where the body begins [m].
            zone: where the potential begins, outside the margin [m].
            force: its scale [m].
        """


def nearest_note(residual_m: float) -> str:
    """Note of an answer that does not meet its target."""
    return f"the nearest answer found within the limits leaves {m_to_mm(residual_m):.6g} mm"
