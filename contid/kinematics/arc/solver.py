"""What solves the inverse kinematics of a chain of arcs: the interface of the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

from contid.kinematics.array import Array
from contid.targets import Actuation, Vec3
from contid.units import m_to_mm

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
    ) -> SectionSolution:
        """The best bounded lengths for a tip [m] and maybe its unit tangent, its frame or the mid-point [m].

        Continuous from ``seed`` where the target allows it.
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
            obstacles: rows of `contid.clearance.obstacles.Obstacle.packed` in the base frame.
            radius: radius of the body [m].
            margin: least distance of surfaces [m].
            from_: arc length where the body begins [m].
            zone: where the potential begins, outside the margin [m].
            force: its scale [m].
        """


def nearest_note(residual_m: float) -> str:
    """Note of an answer that does not meet its target."""
    return f"the nearest answer found within the limits leaves {m_to_mm(residual_m):.6g} mm"
