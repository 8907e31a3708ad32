"""The convex set of bends a tendon robot may take, with a name for every limit.

In the variables ``x = L Theta`` [m] of `BendSections`:

* travel of every tendon: planes, since pulls are linear in the bends. With elastic tendons a pull has a part
  for the stretch that keeps the section taut (`TendonStatics`). Its maximum is the maximum of several planes.
  Its minimum is kept for a tendon at the floor: exact for the tendon of a section that is paid out most, and
  on the safe side for others;
* largest tension of every tendon: planes; the least tension holds by the choice of the mean pull;
* largest bend of every section: a cone.

A point outside is brought inside by straightening the robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from contid.kernels import load
from contid.kinematics.arc.feasible import BoundedChain, feasible_share
from contid.kinematics.arc.solver import Solver, Tuning
from contid.kinematics.array import Array
from contid.kinematics.tendon.geometry import BendSections, TendonGeometry
from contid.kinematics.tendon.tension import TendonStatics


class PullPlane(NamedTuple):
    """A limit ``row Theta <= bound`` of the bends.

    Attributes:
        name: of the limit; several planes can share one.
        row: by the bends [m/rad], shape ``(2 n,)``.
        bound_m: its bound.
    """

    name: str
    row: Array
    bound_m: float


@dataclass(frozen=True, eq=False)
class TendonFeasible(BoundedChain):
    """Limits of one robot.

    Attributes:
        sections: the chain.
        bend_max_rad: largest bend of each section [rad].
        normals, offsets: planes ``normals x <= offsets`` [m], shapes ``(planes, 2 n)`` and ``(planes,)``.
        plane_names: name of each plane's limit; several planes can share one.
        home: the straight robot.
        low, high: a box around the cones [m].
    """

    sections: BendSections
    bend_max_rad: tuple[float, ...]
    normals: Array
    offsets: Array
    plane_names: tuple[str, ...]
    home: Array = field(init=False)
    low: Array = field(init=False)
    high: Array = field(init=False)

    def __post_init__(self) -> None:
        size = 2 * self.sections.count
        high = np.repeat(self.sections.backbone_m, 2) * np.repeat(self.bend_max_rad, 2)
        for name, value in (
            ("home", np.zeros(size)),
            ("low", -high),
            ("high", high),
        ):
            object.__setattr__(self, name, value)
        if not np.all(self.excess(self.home) < 0.0):
            raise ValueError("the straight robot is not inside the limits")

    @classmethod
    def of(
        cls, geometry: TendonGeometry, bend_max_rad: Sequence[float], planes: Sequence[PullPlane]
    ) -> TendonFeasible:
        """From limits of the bends."""
        sections = BendSections.of(geometry)
        per_length = 1.0 / np.repeat(sections.backbone_m, 2)
        return cls(
            sections,
            tuple(bend_max_rad),
            np.array([plane.row for plane in planes]) * per_length,
            np.array([plane.bound_m for plane in planes]),
            tuple(plane.name for plane in planes),
        )

    @property
    def flat(self) -> int:
        """Number of planes; the cones follow."""
        return len(self.offsets)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the limits in the order of the bits of `binding`."""
        return (*self.plane_names, *(f"s{s + 1}.bend" for s in range(self.sections.count)))

    def excess(self, lengths: Array) -> Array:
        """By how much every limit is exceeded [m], negative inside, in the order of `names`."""
        bend = np.hypot(lengths[0::2], lengths[1::2])
        cones = bend - np.array(self.sections.backbone_m) * np.array(self.bend_max_rad)
        return np.concatenate((self.normals @ lengths - self.offsets, cones))

    def pulled(self, lengths: Array | Sequence[float]) -> Array:
        """The first feasible point on the way from there (clipped to the box) to the straight robot."""
        clipped = np.clip(np.asarray(lengths, dtype=np.float64), self.low, self.high)
        share = feasible_share(self.excess(clipped), self.excess(self.home))
        return clipped if share == 1.0 else np.asarray(share * clipped, dtype=np.float64)


def limits_of(
    geometry: TendonGeometry,
    names: Sequence[str],
    lower_m: Sequence[float],
    upper_m: Sequence[float],
    bend_max_rad: Sequence[float],
    statics: TendonStatics | None = None,
) -> TendonFeasible:
    """Limits of travel [m] per tendon, of bends [rad] per section, and of tension where it is described."""
    planes: list[PullPlane] = []
    for tendon, (name, row) in enumerate(zip(names, geometry.pull_matrix, strict=True)):
        paid_out = 0.0
        if statics is not None:
            paid_out = float((statics.floor_n - statics.rest_n[tendon]) / statics.tendon_n_per_m[tendon])
        planes.append(PullPlane(f"{name}.min", -row, paid_out - lower_m[tendon]))
        if statics is None:
            planes.append(PullPlane(f"{name}.max", row, upper_m[tendon]))
    if statics is not None:
        k, pieces = statics.tendon_n_per_m.tolist(), statics.pieces()
        for tendon, by_bends, at_rest in pieces:
            stretch = (at_rest - float(statics.rest_n[tendon])) / k[tendon]
            row = geometry.pull_matrix[tendon] + by_bends / k[tendon]
            planes.append(PullPlane(f"{names[tendon]}.max", row, upper_m[tendon] - stretch))
        for tendon, by_bends, at_rest in pieces:
            if np.any(by_bends):
                bound = (statics.limit_n - at_rest) / k[tendon]
                planes.append(PullPlane(f"{names[tendon]}.tension", by_bends / k[tendon], bound))
    return TendonFeasible.of(geometry, bend_max_rad, planes)


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
