"""Statics of the backbone as a rod: tendons, gravity, a force on the tip, torsion and a stretching backbone.

Every section is a chain of elements of constant strain. An element of length h turns by ``w = (-v, u, t)``,
bend (u, v) and twist t, and stretches by the share e; its tendons, at the arm r, have the length

    h sqrt((1 + e - r . (u, v) / h)^2 + (|r| t / h)^2),

exactly, for tendons parallel to the backbone. Equilibrium is where the virtual work vanishes:

    stiffness * strain + sum over tendons tau dL/dx - weights . dp/dx - force . dtip/dx = 0,
    tau at the spool = rest + k (pull - shortening),     never below 0,
    tau in element e = tau at the spool * exp(-+ mu bend up to e)        (capstan; - while pulled in).

The kernel ``contid/kernels/tendon/rod.hpp`` solves it; `twin` is its specification.

For more and more elements that is the tendon-actuated Cosserat rod without shear of D. C. Rucker and R. J.
Webster III, "Statics and Dynamics of Continuum Robots With General Tendon Routing and External Loading", IEEE
Trans. Robotics 27(6), 2011. The error falls with the square of their number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from contid.kernels import load
from contid.kinematics.array import Array
from contid.kinematics.tendon.geometry import TendonGeometry
from contid.kinematics.tendon.rod_chain import ElementChain, chain_of, local_twists
from contid.kinematics.tendon.rod_terms import capstan_slope, second_of_lengths, turned_loads
from contid.targets import ZERO3, Vec3

_STEPS: Final = 60
#: Equilibrium: moments left over, as a share of the largest stiffness times a radian.
_EXACT: Final = 1e-11
#: Trust: no element turns by more in one step [rad], none stretches by more.
_LARGEST: Final = 0.3


@dataclass(frozen=True, eq=False)
class TendonEquilibrium:
    """The rod in equilibrium, in the base frame.

    Attributes:
        points_m: ends of the elements from the base on, rigid pieces included, ``(nodes, 3)``.
        tip_m: tip of the robot ``(3,)``.
        rotation: frame of the tip ``(3, 3)``.
        ends_m: end of each section, its rigid piece included, ``(sections, 3)``.
        tensions_n: at the spools ``(tendons,)`` [N].
        strain: of every element: bend u, v, twist [rad], stretch; ``(elements, 4)``.
        jacobian: derivative of the tip by the pulls ``(3, tendons)``.
        compliance: derivative of the tip by a force on it [m/N], ``(3, 3)``.
        left_nm: moment that is left over [N m].
    """

    points_m: Array
    tip_m: Array
    rotation: Array
    ends_m: Array
    tensions_n: Array
    strain: Array
    jacobian: Array
    compliance: Array
    left_nm: float


class RodKernel(Protocol):
    """Interface of the native rod; arrays of the caller are filled."""

    def solve(
        self, pulls: Array, force: Vec3, start: Array, slides: Array, strain: Array, points: Array,
        rotation: Array, tensions: Array, tip: Array, jacobian: Array, compliance: Array, derivatives: bool,
    ) -> float:  # fmt: skip
        """Moment left over [N m], below 0 when no equilibrium was found."""
        ...


@dataclass(frozen=True, eq=False)
class TendonRod:
    """Rod of a tendon robot.

    Attributes:
        geometry: sections and tendons; tendons run through earlier sections.
        bending_n_m2: E I of each section [N m^2].
        torsion_n_m2: G J of each section [N m^2].
        stretch_n: E A of each section [N]; infinite for an inextensible backbone.
        tendon_n_per_m: stiffness of each tendon [N/m].
        rest_n: tensions of the straight rod at zero pulls [N].
        weight_n_per_m: weight of each section [N/m], vectors in the base frame ``(sections, 3)``.
        capstan: mu.
        elements: of a section.
    """

    geometry: TendonGeometry
    bending_n_m2: Sequence[float]
    torsion_n_m2: Sequence[float]
    stretch_n: Sequence[float]
    tendon_n_per_m: Sequence[float]
    rest_n: Sequence[float]
    weight_n_per_m: Array
    capstan: float = 0.0
    elements: int = 8
    _stiffness: Array = field(init=False)
    _h: Array = field(init=False)
    _arms: Array = field(init=False)
    _kernel: RodKernel | None = field(init=False)

    def __post_init__(self) -> None:
        m, sections = self.elements, self.geometry.sections
        h = np.repeat([section.length_m / m for section in sections], m)
        bending, torsion, stretch = (
            np.repeat(np.asarray(each, dtype=np.float64), m)
            for each in (self.bending_n_m2, self.torsion_n_m2, self.stretch_n)
        )
        stretch = np.where(np.isfinite(stretch), stretch, 0.0)
        stiffness = np.stack((bending / h, bending / h, torsion / h, stretch * h), axis=1)
        # Arm of every tendon in every element, and whether it passes there.
        arms = np.full((len(h), self.geometry.tendons, 2), np.nan)
        for j, rows in enumerate(self.geometry.tendon_slices):
            first = 0 if self.geometry.through else j * m
            arms[first : (j + 1) * m, rows] = sections[j].arms
        for name, value in (("_stiffness", stiffness), ("_h", h), ("_arms", arms)):
            object.__setattr__(self, name, value)
        kernel = load("tendon_rod")
        object.__setattr__(self, "_kernel", None if kernel is None else kernel.Rod(self._setup()))

    @property
    def _rigid(self) -> Array:
        """Rigid piece after each element [m]."""
        rigid = np.zeros(len(self._h))
        rigid[self.elements - 1 :: self.elements] = [section.rigid_m for section in self.geometry.sections]
        return rigid

    def even(self, bends: Array) -> Array:
        """Strain ``(elements, 4)`` of sections of constant curvature with bends ``(2 sections,)`` [rad]."""
        strain = np.zeros((len(self._h), 4))
        strain[:, :2] = np.repeat(bends.reshape(-1, 2) / self.elements, self.elements, axis=0)
        return strain

    def curve(self, strain: Array, parts: int) -> Array:
        """Backbone of a strain, each element in ``parts``, rigid pieces and the tip last [m]."""
        m = parts
        rigid = np.zeros(m * len(self._h))
        rigid[m - 1 :: m] = self._rigid
        fine = chain_of(
            np.repeat(strain, m, axis=0) * np.array([1.0 / m, 1.0 / m, 1.0 / m, 1.0]),
            np.repeat(self._h / m, m), rigid, self.geometry.base_offset_m,
        )  # fmt: skip
        tip = fine.points[-1] + fine.rotations[-1] @ np.array(self.geometry.tip_offset_m)
        return np.concatenate((np.zeros((1, 3)), fine.points, tip[None, :]))

    @property
    def stretches(self) -> bool:
        """Whether the backbone is extensible."""
        return bool(np.all(self._stiffness[:, 3] > 0.0))

    def solve(
        self,
        pulls: Array,
        tip_force_n: Vec3 = ZERO3,
        start: Array | None = None,
        sliding: Array | None = None,
        derivatives: bool = True,
    ) -> TendonEquilibrium:
        """Equilibrium for pulls ``(tendons,)`` [m].

        Args:
            pulls: of the tendons.
            tip_force_n: force on the tip, in the base frame.
            start: strain to start from ``(elements, 4)``; the straight rod without.
            sliding: of each tendon for the capstan: 1 pulled in, -1 paid out, 0 none.
            derivatives: False leaves ``jacobian`` and ``compliance`` at NaN, which is faster.

        Raises:
            ArithmeticError: no equilibrium was found.
        """
        if self._kernel is None:
            return self.twin(pulls, tip_force_n, start, sliding)
        count, tendons = len(self._h), self.geometry.tendons
        strain, points, tensions = np.empty((count, 4)), np.empty((count + 1, 3)), np.empty(tendons)
        rotation, tip = np.empty((3, 3)), np.empty(3)
        jacobian, compliance = np.full((3, tendons), np.nan), np.full((3, 3), np.nan)
        left = self._kernel.solve(
            np.ascontiguousarray(pulls, dtype=np.float64), tip_force_n,
            np.zeros((count, 4)) if start is None else np.ascontiguousarray(start),
            np.zeros(tendons) if sliding is None else np.asarray(sliding, dtype=np.float64),
            strain, points, rotation, tensions, tip, jacobian, compliance, derivatives,
        )  # fmt: skip
        if left < 0.0:
            raise ArithmeticError("no equilibrium of the rod found")
        ends = points[self.elements :: self.elements]
        return TendonEquilibrium(points, tip, rotation, ends, tensions, strain, jacobian, compliance, left)

    def twin(
        self,
        pulls: Array,
        tip_force_n: Vec3 = ZERO3,
        start: Array | None = None,
        sliding: Array | None = None,
    ) -> TendonEquilibrium:
        """`solve` in NumPy."""
        count = len(self._h)
        x = np.zeros((count, 4)) if start is None else np.array(start)
        free = np.arange(4) < (4 if self.stretches else 3)
        free = np.tile(free, count)
        force = np.array(tip_force_n)
        scale = float(np.max(self._stiffness[:, 0]))
        slides = np.zeros(self.geometry.tendons) if sliding is None else np.asarray(sliding)
        state = self._balance(x, pulls, force, slides)
        for _ in range(_STEPS):
            size = float(np.linalg.norm(state.left[free]))
            if size <= _EXACT * scale:
                return self._shape(x, state, free, size)
            step = np.zeros(4 * count)
            step[free] = np.linalg.solve(state.stiffness[np.ix_(free, free)], -state.left[free])
            moved = step.reshape(count, 4)
            share = min(1.0, _LARGEST / max(float(np.abs(moved).max()), 1e-300))
            while True:
                after = self._balance(x + share * moved, pulls, force, slides)
                smaller = float(np.linalg.norm(after.left[free])) < (1.0 - 1e-4 * share) * size
                if smaller or share < 1e-4:
                    break
                share *= 0.5
            x, state = x + share * moved, after
        size = float(np.linalg.norm(state.left[free]))
        if size <= 1e4 * _EXACT * scale:
            return self._shape(x, state, free, size)
        raise ArithmeticError(f"no equilibrium of the rod found: {size:.3g} N m are left over")

    def _setup(self) -> SimpleNamespace:
        """The rod for its kernel."""
        return SimpleNamespace(
            lengths=self._h, stiffness=self._stiffness, arms=self._arms, rigid=self._rigid,
            tendon=np.array(self.tendon_n_per_m), rest=np.array(self.rest_n, dtype=np.float64),
            weight=self._h[:, None] * np.repeat(self.weight_n_per_m, self.elements, axis=0),
            offset=np.array(self.geometry.tip_offset_m), base_m=self.geometry.base_offset_m,
            per_section=self.elements, stretches=self.stretches, capstan=self.capstan,
        )  # fmt: skip

    def _balance(self, x: Array, pulls: Array, force: Array, slides: Array) -> _Balance:
        """Virtual work of a strain ``(elements, 4)`` and its derivative."""
        count = len(self._h)
        chain = chain_of(x, self._h, self._rigid, self.geometry.base_offset_m)
        tip = chain.points[-1] + chain.rotations[-1] @ np.array(self.geometry.tip_offset_m)
        # Weight of an element: half at each of its ends.
        weights = np.zeros((count + 1, 3))
        half = 0.5 * self._h[:, None] * np.repeat(self.weight_n_per_m, self.elements, axis=0)
        weights[:-1] += half
        weights[1:] += half
        # Wrench of everything beyond the start of an element's end, about the origin of the base frame.
        forces = np.cumsum(weights[:0:-1], axis=0)[::-1] + force
        moments = np.cumsum(np.cross(chain.points[:0:-1], weights[:0:-1]), axis=0)[::-1] + np.cross(
            tip, force
        )
        load = np.einsum("ekj,ej->ek", chain.axes, moments) + np.einsum("ekj,ej->ek", chain.shifts, forces)
        # Tendons.
        h = self._h[:, None]
        along = 1.0 + x[:, 3:] - np.einsum("eij,ej->ei", self._arms, x[:, :2]) / h
        around2 = np.sum(self._arms**2, axis=-1) / h**2
        root = np.sqrt(along**2 + around2 * x[:, 2:3] ** 2)
        passes = ~np.isnan(root)
        ratio = np.where(passes, along / root, 0.0)
        arms = np.where(passes[:, :, None], self._arms, 0.0)
        around2 = np.where(passes, around2, 0.0)
        root = np.where(passes, root, 1.0)
        shortening = np.sum(np.where(passes, h * (1.0 - root), 0.0), axis=0)
        dl = np.stack(
            (
                -arms[:, :, 0] * ratio,
                -arms[:, :, 1] * ratio,
                h * around2 * x[:, 2:3] / root,
                np.where(passes, h * ratio, 0.0),
            ),
            axis=2,
        )  # (elements, tendons, 4)
        k = np.asarray(self.tendon_n_per_m)
        spool = np.asarray(self.rest_n) + k * (np.asarray(pulls) - shortening)
        taut = spool > 0.0
        spool = np.where(taut, spool, 0.0)
        bend = np.hypot(x[:, 0], x[:, 1])
        before = np.cumsum(bend) - 0.5 * bend
        share = np.exp(-self.capstan * slides[None, :] * before[:, None])
        left = self._stiffness * x + np.einsum("ei,eik->ek", share * spool, dl) - load
        # Derivative: stiffness, tendons that stretch, their change of direction by twist, loads that turn.
        size = 4 * count
        flat = (share[:, :, None] * dl).transpose(0, 2, 1).reshape(size, -1)
        plain = dl.transpose(0, 2, 1).reshape(size, -1)
        stiffness = np.diag(self._stiffness.ravel()) + (flat * np.where(taut, k, 0.0)) @ plain.T
        by_element = stiffness.reshape(count, 4, count, 4)
        own = np.arange(count)
        by_element[own, :, own, :] += second_of_lengths(
            share * spool, arms, x[:, 2:3], around2, ratio, root, h
        )
        stiffness += capstan_slope(self.capstan, share * spool, dl, slides, x, bend)
        axes = chain.axes.reshape(size, 3)
        # d/dx_e of the work of a load on x_f, e before f: the axis of e turns what f moves.
        moved = np.cross(chain.shifts.reshape(size, 3), np.repeat(forces, 4, axis=0)) + turned_loads(
            chain.axes, chain, weights, force, tip
        )
        geometric = -(axes @ moved.T)
        element = np.repeat(np.arange(count), 4)
        upper = np.where(element[:, None] < element[None, :], geometric, 0.0)
        # Within an element its own axes turn too; complex steps are exact to rounding.
        same = geometric.reshape(count, 4, count, 4)[own, :, own, :]
        for n in range(4):
            moved_x = x.astype(np.complex128)
            moved_x[:, n] += 1e-30j
            spin, local, _, _ = local_twists(moved_x, self._h)
            axes_by = np.einsum("eij,ekj->eki", chain.rotations[:-1], spin.imag / 1e-30)
            shifts_by = np.einsum("eij,ekj->eki", chain.rotations[:-1], local.imag / 1e-30)
            shifts_by += np.cross(chain.points[:-1, None, :], axes_by)
            same[:, :, n] -= np.einsum("ekj,ej->ek", axes_by, moments)
            same[:, :, n] -= np.einsum("ekj,ej->ek", shifts_by, forces)
        stiffness += upper + upper.T
        by_element[own, :, own, :] += same
        by_pull = flat * np.where(taut, k, 0.0)
        return _Balance(left.ravel(), stiffness, spool, by_pull, chain, tip)

    def _shape(self, x: Array, state: _Balance, free: NDArray[np.bool_], left: float) -> TendonEquilibrium:
        chain = state.chain
        size = 4 * len(self._h)
        axes, shifts = chain.axes.reshape(size, 3), chain.shifts.reshape(size, 3)
        tip_by_x = np.cross(axes, state.tip) + shifts
        tip_by_x = tip_by_x[free]
        inverse = np.linalg.solve(
            state.stiffness[np.ix_(free, free)], np.hstack((-state.by_pull[free], tip_by_x))
        )
        by_pull, by_force = inverse[:, :-3], inverse[:, -3:]
        ends = chain.points[self.elements :: self.elements]
        return TendonEquilibrium(
            chain.points, state.tip, chain.rotations[-1], ends, state.tensions, x,
            tip_by_x.T @ by_pull, tip_by_x.T @ by_force, left,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Balance:
    left: Array
    stiffness: Array
    tensions: Array
    by_pull: Array
    chain: ElementChain
    tip: Array
