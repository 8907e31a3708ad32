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

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Protocol

import numpy as np

from contid.kernels import load
from contid.kinematics.array import Array
from contid.kinematics.tendon.geometry import TendonGeometry
from contid.targets import ZERO3, Vec3


@dataclass(frozen=True, eq=False)
class RodElements:
    """Elements of a rod from the base on; the kernel reads the fields by name.

    Attributes:
        lengths: lengths of the elements [m].
        stiffness: stiffness of each element: bend u, v, twist [N m], stretch [N m], 0 without; ``(elements,
            4)``.
        arms: lever arms of every tendon in every element [m], NaN where it does not pass; ``(elements,
            tendons, 2)``.
        rigid: length of the rigid piece after each element [m].
        tendon: stiffness of each tendon [N/m].
        rest: tensions of the straight rod at zero pulls [N].
        weight: weight of each element [N], in the base frame; ``(elements, 3)``.
        offset: position of the tip, in the frame of the last element [m].
        base_m: length before the first element [m].
        per_section: elements of a section.
        stretches: the backbone is extensible.
    """

    lengths: Array
    stiffness: Array
    arms: Array
    rigid: Array
    tendon: Array
    rest: Array
    weight: Array
    offset: Array
    base_m: float
    per_section: int
    stretches: bool


@dataclass(frozen=True, eq=False)
class TendonEquilibrium:
    """The rod in equilibrium, in the base frame.

    Attributes:
        points_m: ends of the elements from the base on, rigid pieces included, ``(nodes, 3)``.
        tip_m: tip of the robot ``(3,)``.
        rotation: frame of the tip ``(3, 3)``.
        ends_m: end of each section, its rigid piece included, ``(sections, 3)``.
        tensions_n: tensions of the tendons ``(tendons,)`` [N].
        strain: strain of every element: bend u, v, twist [rad], stretch; ``(elements, 4)``.
        jacobian: derivative of the tip by the pulls ``(3, tendons)``.
        compliance: derivative of the tip by a force on it [m/N], ``(3, 3)``.
        stable: it is a minimum of energy; False for a rod that buckles away from it.
    """

    points_m: Array
    tip_m: Array
    rotation: Array
    ends_m: Array
    tensions_n: Array
    strain: Array
    jacobian: Array
    compliance: Array
    stable: bool = True


class RodKernel(Protocol):
    """Interface of the compiled rod."""

    def solve(
        self, pulls: Array, force: Vec3, start: Array, into: TendonEquilibrium, derivatives: bool
    ) -> int:
        """Fill the arrays of ``into``; 1 for a stable equilibrium, 0 for another one, below 0 for none."""


class TendonRod:
    """Rod of a tendon robot.

    Args:
        geometry: sections and tendons; tendons run through earlier sections.
        bending_n_m2: E I of each section [N m^2].
        torsion_n_m2: G J of each section [N m^2].
        stretch_n: E A of each section [N]; one that is infinite makes the whole backbone inextensible.
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
        stable = self._kernel.solve(given, tip_force_n, begin, found, derivatives)
        if stable < 0:
            raise ArithmeticError("no equilibrium of the rod found")
        return found if stable else replace(found, stable=False)


#: Terms of the series in the square of an element's turn, which stays far below half a turn.
_TERMS: Final = range(12)


class PlacedElements(NamedTuple):
    """Start and ends of the elements [m], ``(elements + 1, 3)``; rotation of the last end to the base."""

    points: Array
    last_frame: Array


def place_elements(strain: Array, lengths_m: Array, rigid_m: Array, base_m: float) -> PlacedElements:
    """Chain the elements of a rod one after the other, from ``base_m`` above the origin along z.

    An element turns by ``w = (-v, u, t)`` with bend (u, v) and twist t, and its end lies at

        h (1 + e) (e_z + B w x e_z + C w x (w x e_z)),   B = (1 - cos |w|)/|w|^2,   C = (|w| - sin |w|)/|w|^3

    in the frame of its start; ``rigid_m[i]`` follows along the local z.
    """
    w = np.stack((-strain[:, 1], strain[:, 0], strain[:, 2]), axis=1)
    square = np.sum(w * w, axis=1)
    a, b, c = (_series(square, offset)[:, None] for offset in (1, 2, 3))
    across = np.cross(w, (0.0, 0.0, 1.0))
    stretched = (lengths_m * (1.0 + strain[:, 3]))[:, None]
    ends = stretched * (np.array((0.0, 0.0, 1.0)) + b * across + c * np.cross(w, across))
    skew = np.cross(np.eye(3), w[:, None, :])  # skew v = w x v
    turns = np.eye(3) + a[:, :, None] * skew + b[:, :, None] * (skew @ skew)
    ends = ends + rigid_m[:, None] * turns[:, :, 2]
    points, frame = np.empty((len(w) + 1, 3)), np.eye(3)
    points[0] = (0.0, 0.0, base_m)
    for n, (end, turn) in enumerate(zip(ends, turns, strict=True)):
        points[n + 1] = points[n] + frame @ end
        frame = frame @ turn
    return PlacedElements(points, frame)


def _series(square: Array, offset: int) -> Array:
    """``sum_n (-square)^n / (2 n + offset)!``: sin t / t, (1 - cos t)/t^2, (t - sin t)/t^3 for 1, 2, 3."""
    terms = np.stack([(-square) ** n / math.factorial(2 * n + offset) for n in _TERMS])
    return np.asarray(terms.sum(axis=0))
