"""`ElasticRod`: the equilibrium of a passive rod under gravity and wrenches along it.

Units are mm, N and N·mm, or SI with ``si=True``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from contid.api.arguments import ArgumentError, as_rows
from contid.kinematics.array import Array
from contid.kinematics.cosserat.engine import RodSetup, RodSolver, build_engine
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod, Section
from contid.kinematics.cosserat.solve import Limits
from contid.units import MM_PER_M

#: Steps of a piece to begin with, and the estimated error at which they are doubled, as a part of the length.
ELEMENTS: Final = 4
ERROR: Final = 1e-4
#: Wrenches inside the rod at most: the kernel takes eight pieces.
MOST_INSIDE: Final = 7
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
        rotations: frames of the cross-sections, shape (n, 3, 3); the third column is the tangent's.
        carried: 1.0; less where the rod buckles or jumps at that part of the loads, which grow together: the
            shape is then another equilibrium, if one was found, and statics does not determine it.
    """

    points: Array
    rotations: Array
    carried: float


class ElasticRod:
    """A straight round rod along +z of the base frame, clamped at the origin.

    It bends, twists, shears and stretches.

    Args:
        length: of the rod.
        radius: of its cross-section.
        modulus_pa: Young's modulus [Pa], in all units.
        poisson: Poisson's ratio.
        density_kg_m3: for its own weight; 0 for none.
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
        self._mm = MM_PER_M if si else 1.0
        self._section = Section.solid(length * self._mm, radius * self._mm, modulus_pa, poisson)
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
        full = self._section.length
        at = self._stations(stations)
        weight = self._mass_kg_mm * as_rows("gravity", gravity, ("gx", "gy", "gz"))[0][0]
        force, moment = np.zeros(3), np.zeros(3)
        inside: dict[float, tuple[Array, Array]] = {}
        for load in loads:
            push = as_rows("force", load.force, ("fx_n", "fy_n", "fz_n"))[0][0]
            turn = self._mm * as_rows("moment", load.moment, ("mx", "my", "mz"))[0][0]
            where = load.at * self._mm
            if not 0.0 <= where <= full:
                raise ArgumentError(f"wrench at {load.at}; allowed: 0 to {self.length} {self.unit}")
            if where == full:
                force, moment = force + push, moment + turn
            elif where > 0.0:  # the clamp carries what acts at the base
                before = inside.get(where, (np.zeros(3), np.zeros(3)))
                inside[where] = before[0] + push, before[1] + turn
        ends = (*sorted(inside), full)
        acting = Loads(
            force,
            moment,
            {i: inside[end][0] for i, end in enumerate(ends[:-1])},
            {i: inside[end][1] for i, end in enumerate(ends[:-1])},
            dict.fromkeys(range(len(ends)), weight) if weight.any() else {},
        )
        frames = np.empty((len(at), 12))
        carried, _, _ = self._solver(ends).statics([0.0] * (3 * len(ends)), acting, at, frames)
        return RodShape(frames[:, :3] / self._mm, frames[:, 3:].reshape(-1, 3, 3), carried)

    def _stations(self, stations: ArrayLike) -> Array:
        at = np.array(stations, dtype=float, ndmin=1) * self._mm
        inside = at.ndim == 1 and bool(np.all((at >= 0.0) & (at <= self._section.length)))
        if not inside or bool(np.any(np.diff(at) < 0.0)):
            raise ArgumentError(
                f"stations={np.asarray(stations).tolist()}; "
                f"expected: arc lengths that ascend from 0 to {self.length} {self.unit}"
            )
        return at

    def _solver(self, ends: tuple[float, ...]) -> RodSolver:
        """The rod cut where wrenches act, kept for the next call."""
        if ends not in self._solvers:
            if len(ends) > MOST_INSIDE + 1:
                raise ArgumentError(
                    f"wrenches at {len(ends) - 1} points inside the rod; at most {MOST_INSIDE}"
                )
            starts = (0.0, *ends[:-1])
            pieces = tuple(self._section.cut(end - start) for start, end in zip(starts, ends, strict=True))
            none = np.zeros(3 * len(ends))
            error = ERROR * self._section.length
            self._solvers.clear()
            self._solvers[ends] = build_engine(
                RodSetup(Rod(pieces), Loads(), Limits(none, none, none), ELEMENTS, error, 0.0, 1.0, False)
            )
        return self._solvers[ends]
