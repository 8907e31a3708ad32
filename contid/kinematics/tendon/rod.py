"""Statics of the backbone as a rod: tendons, gravity, a force on the tip, torsion and a stretching backbone.

Every section is a chain of elements of constant strain. An element of length h turns by ``w = (-v, u, t)``,
bend (u, v) and twist t, and stretches by the share e; its tendons, at the arm r, have the length

    h sqrt((1 + e - r . (u, v) / h)^2 + (|r| t / h)^2),

exactly, for tendons parallel to the backbone. Equilibrium is where the virtual work vanishes:

    stiffness * strain + sum over tendons tau dL/dx - weights . dp/dx - force . dtip/dx = 0,
    tau = rest + k (pull - shortening),     never below 0.

The kernel ``contid/kernels/tendon/rod.hpp`` solves it by Newton's method.

For more and more elements that is the tendon-actuated Cosserat rod without shear of D. C. Rucker and R. J.
Webster III, "Statics and Dynamics of Continuum Robots With General Tendon Routing and External Loading", IEEE
Trans. Robotics 27(6), 2011. The error falls with the square of their number.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from contid.kernels import load
from contid.kinematics.array import Array
from contid.kinematics.tendon.geometry import TendonGeometry
from contid.kinematics.tendon.rod_chain import place_elements
from contid.kinematics.tendon.rod_elements import RodElements, TendonEquilibrium
from contid.targets import ZERO3, Vec3


class RodKernel(Protocol):
    """Interface of the compiled rod."""

    def solve(
        self, pulls: Array, force: Vec3, start: Array, into: TendonEquilibrium, derivatives: bool
    ) -> float:
        """Fill the arrays of ``into``; the moment left over [N m], below 0 when no equilibrium was found."""


class TendonRod:
    """Rod of a tendon robot.

    Args:
        geometry: sections and tendons; tendons run through earlier sections.
        bending_n_m2: E I of each section [N m^2].
        torsion_n_m2: G J of each section [N m^2].
        stretch_n: E A of each section [N]; infinite for an inextensible backbone.
        tendon_n_per_m: stiffness of each tendon [N/m].
        rest_n: tensions of the straight rod at zero pulls [N].
        weight_n_per_m: weight of each section [N/m], vectors in the base frame ``(sections, 3)``.
        elements: number of elements of a section.

    Attributes:
        discrete: the rod as elements.
    """

    def __init__(
        self,
        geometry: TendonGeometry,
        bending_n_m2: Sequence[float],
        torsion_n_m2: Sequence[float],
        stretch_n: Sequence[float],
        tendon_n_per_m: Sequence[float] | Array,
        rest_n: Sequence[float] | Array,
        weight_n_per_m: Array,
        elements: int = 8,
    ) -> None:
        self.geometry, self.elements = geometry, elements
        m, sections = elements, geometry.sections
        h = np.repeat([section.length_m / m for section in sections], m)
        bending, torsion, stretch = (
            np.repeat(np.asarray(each, dtype=np.float64), m)
            for each in (bending_n_m2, torsion_n_m2, stretch_n)
        )
        stretch = np.where(np.isfinite(stretch), stretch, 0.0)
        stiffness = np.stack((bending / h, bending / h, torsion / h, stretch * h), axis=1)
        # Arm of every tendon in every element, and whether it passes there.
        arms = np.full((len(h), geometry.tendons, 2), np.nan)
        for j, rows in enumerate(geometry.tendon_slices):
            first = 0 if geometry.through else j * m
            arms[first : (j + 1) * m, rows] = sections[j].arms
        rigid = np.zeros(len(h))
        rigid[m - 1 :: m] = [section.rigid_m for section in sections]
        self.discrete = RodElements(
            h, stiffness, arms, rigid,
            tendon=np.array(tendon_n_per_m), rest=np.array(rest_n, dtype=np.float64),
            weight=h[:, None] * np.repeat(weight_n_per_m, m, axis=0),
            offset=np.array(geometry.tip_offset_m), base_m=geometry.base_offset_m,
            per_section=m, stretches=bool(np.all(stiffness[:, 3] > 0.0)),
        )  # fmt: skip
        self._kernel: RodKernel = load("tendon_rod").Rod(self.discrete)

    def even(self, bends: Array) -> Array:
        """Strain ``(elements, 4)`` of sections of constant curvature with bends ``(2 sections,)`` [rad]."""
        strain = np.zeros((len(self.discrete.lengths), 4))
        strain[:, :2] = np.repeat(bends.reshape(-1, 2) / self.elements, self.elements, axis=0)
        return strain

    def curve(self, strain: Array, parts: int) -> Array:
        """Backbone of a strain, each element in ``parts``, rigid pieces and the tip last [m]."""
        m, elements = parts, self.discrete
        rigid = np.zeros(m * len(elements.lengths))
        rigid[m - 1 :: m] = elements.rigid
        points, turn = place_elements(
            np.repeat(strain, m, axis=0) * np.array([1.0 / m, 1.0 / m, 1.0 / m, 1.0]),
            np.repeat(elements.lengths / m, m), rigid, elements.base_m,
        )  # fmt: skip
        tip = points[-1] + turn @ elements.offset
        return np.concatenate((np.zeros((1, 3)), points, tip[None, :]))

    def solve(
        self,
        pulls: Array,
        tip_force_n: Vec3 = ZERO3,
        start: Array | None = None,
        derivatives: bool = True,
    ) -> TendonEquilibrium:
        """Equilibrium for pulls ``(tendons,)`` [m].

        Args:
            pulls: pulls of the tendons.
            tip_force_n: force on the tip, in the base frame.
            start: strain to start from ``(elements, 4)``; the straight rod without.
            derivatives: False leaves ``jacobian`` and ``compliance`` at NaN, which is faster.

        Raises:
            ArithmeticError: no equilibrium was found.
        """
        count, tendons = len(self.discrete.lengths), self.geometry.tendons
        points_m = np.empty((count + 1, 3))
        found = TendonEquilibrium(
            points_m,
            tip_m=np.empty(3),
            rotation=np.empty((3, 3)),
            ends_m=points_m[self.elements :: self.elements],
            tensions_n=np.empty(tendons),
            strain=np.empty((count, 4)),
            jacobian=np.full((3, tendons), np.nan),
            compliance=np.full((3, 3), np.nan),
        )
        given = np.ascontiguousarray(pulls, dtype=np.float64)
        begin = np.zeros((count, 4)) if start is None else np.ascontiguousarray(start)
        if self._kernel.solve(given, tip_force_n, begin, found, derivatives) < 0.0:
            raise ArithmeticError("no equilibrium of the rod found")
        return found
