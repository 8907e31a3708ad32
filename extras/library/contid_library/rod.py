"""`ElasticRod`: the equilibrium of a passive rod under gravity and wrenches along it.

Units are mm, N and N·mm, or SI with ``si=True``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from contid.api.arguments import ArgumentError, as_rows_like
from contid.kinematics.array import Array
from contid.kinematics.cosserat.engine import Limits, RodSetup, RodSolver
from contid.kinematics.cosserat.section import Loads, Rod, Section
from contid.units import MM_PER_M

#: Integration steps per piece of the rod to begin with. They are doubled while the estimated error of a
#: position exceeds ``ERROR`` times the length of the rod.
ELEMENTS: Final = 4
ERROR: Final = 1e-4
#: Most points inside the rod at which wrenches act: they cut it into pieces, and the kernel takes eight.
MAX_INSIDE: Final = 7
_NONE: Final = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Wrench:
    """A dead force and moment at one point: they keep their direction in the base frame as the rod bends.

    Attributes:
        at: arc length from the base to the point [mm; SI: m].
        force: [N], x, y, z.
        moment: [N·mm; SI: N·m], x, y, z.
    """

    at: float
    force: ArrayLike = _NONE
    moment: ArrayLike = _NONE


@dataclass(frozen=True, slots=True)
class RodShape:
    """A rod in equilibrium at n stations, in its base frame.

    Attributes:
        points: positions, shape (n, 3).
        rotations: rotation matrices from the frame of each cross-section to the base frame, shape (n, 3, 3);
            the third column is the normal of the cross-section.
        carried: part of the loads, which grow together, that the rod reaches without buckling or a jump; 1.0
            for all of them. Below 1.0 statics does not determine the shape: it is another equilibrium, if
            one was found.
    """

    points: Array
    rotations: Array
    carried: float


class ElasticRod:
    """A straight round rod along +z of the base frame, clamped at the origin.

    It bends, twists, shears and stretches.

    Args:
        length: length of the rod.
        radius: radius of its cross-section.
        modulus_pa: Young's modulus [Pa], in all units.
        poisson: Poisson's ratio.
        density_kg_m3: density, for the weight of the rod; 0 for no weight.
        si: m and N·m instead of mm and N·mm.

    Raises:
        ArgumentError: a dimension or modulus is not positive, or the ratio is outside -1 to 0.5.
    """

    def __init__(
        self,
        length: float,
        radius: float,
        *,
        modulus_pa: float,
        poisson: float,
        density_kg_m3: float = 0.0,
        si: bool = False,
    ) -> None:
        positive = {"length": length, "radius": radius, "modulus_pa": modulus_pa}
        for name, value in positive.items():
            if not 0.0 < value < np.inf:
                raise ArgumentError(f"{name}={value}: a positive number is needed")
        if not -1.0 < poisson <= 0.5:
            raise ArgumentError(f"poisson={poisson}; allowed: above -1, at most 0.5")
        if not 0.0 <= density_kg_m3 < np.inf:
            raise ArgumentError(f"density_kg_m3={density_kg_m3}: 0 or a positive number is needed")
        self.length, self.unit = length, "m" if si else "mm"
        self._mm_per_unit = MM_PER_M if si else 1.0
        length_mm, radius_mm = length * self._mm_per_unit, radius * self._mm_per_unit
        self._section = Section.solid(length_mm, radius_mm, modulus_pa, poisson)
        # kg/m^3 * mm^2 is 1e-9 kg/mm.
        self._mass_kg_mm = density_kg_m3 * self._section.area * 1e-9
        self._solvers: dict[tuple[float, ...], RodSolver] = {}

    def statics(
        self, stations: ArrayLike, *, loads: Sequence[Wrench] = (), gravity: ArrayLike = _NONE
    ) -> RodShape:
        """Shape that the rod reaches when the loads grow together from zero without a jump.

        Args:
            stations: ascending arc lengths from the base, shape (n,).
            loads: wrenches on the rod; several at one point add up.
            gravity: acceleration [m/s^2], x, y, z: ``(0, 0, -9.81)`` for an upright rod.

        Raises:
            ArgumentError: a station or load off the rod, stations that do not ascend, numbers that are not
                finite, or wrenches at more than seven points inside the rod.
        """
        length_mm = self._section.length
        stations_mm = self._stations_mm(stations)
        weight = self._mass_kg_mm * as_rows_like("gravity", gravity, ("gx", "gy", "gz"), ())[0]
        tip_force, tip_moment = np.zeros(3), np.zeros(3)
        inside: dict[float, tuple[Array, Array]] = {}
        for load in loads:
            force = as_rows_like("force", load.force, ("fx_n", "fy_n", "fz_n"), ())[0]
            moment = self._mm_per_unit * as_rows_like("moment", load.moment, ("mx", "my", "mz"), ())[0]
            arc_length_mm = load.at * self._mm_per_unit
            if not 0.0 <= arc_length_mm <= length_mm:
                raise ArgumentError(f"wrench at {load.at}; allowed: 0 to {self.length} {self.unit}")
            if arc_length_mm == length_mm:
                tip_force, tip_moment = tip_force + force, tip_moment + moment
            elif arc_length_mm > 0.0:  # the clamp carries what acts at the base
                others = inside.get(arc_length_mm, (np.zeros(3), np.zeros(3)))
                inside[arc_length_mm] = others[0] + force, others[1] + moment
        ends = (*sorted(inside), length_mm)
        acting = Loads(
            tip_force,
            tip_moment,
            {i: inside[end][0] for i, end in enumerate(ends[:-1])},
            {i: inside[end][1] for i, end in enumerate(ends[:-1])},
            dict.fromkeys(range(len(ends)), weight) if weight.any() else {},
        )
        frames = np.empty((len(stations_mm), 12))
        found = self._solver(ends).statics([0.0] * (3 * len(ends)), acting, stations_mm, frames)
        return RodShape(frames[:, :3] / self._mm_per_unit, frames[:, 3:].reshape(-1, 3, 3), found.carried)

    def _stations_mm(self, stations: ArrayLike) -> Array:
        stations_mm = np.array(stations, dtype=float, ndmin=1) * self._mm_per_unit
        inside = stations_mm.ndim == 1 and bool(
            np.all((stations_mm >= 0.0) & (stations_mm <= self._section.length))
        )
        if not inside or bool(np.any(np.diff(stations_mm) < 0.0)):
            raise ArgumentError(
                f"stations={np.asarray(stations).tolist()}; "
                f"expected: arc lengths that ascend from 0 to {self.length} {self.unit}"
            )
        return stations_mm

    def _solver(self, ends: tuple[float, ...]) -> RodSolver:
        """The rod cut where wrenches act, kept for the next call."""
        if ends not in self._solvers:
            if len(ends) > MAX_INSIDE + 1:
                raise ArgumentError(
                    f"wrenches at {len(ends) - 1} points inside the rod; at most {MAX_INSIDE}"
                )
            starts = (0.0, *ends[:-1])
            pieces = tuple(self._section.cut(end - start) for start, end in zip(starts, ends, strict=True))
            zeros = np.zeros(3 * len(ends))
            error = ERROR * self._section.length
            self._solvers.clear()
            self._solvers[ends] = RodSolver(
                RodSetup(Rod(pieces), Loads(), Limits(zeros, zeros, zeros), ELEMENTS, error, 0.0, 1.0, False)
            )
        return self._solvers[ends]
