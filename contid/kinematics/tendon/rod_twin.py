"""The equilibrium of a tendon rod by Newton's method in NumPy: specification of the native kernel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from contid.kinematics.array import Array
from contid.kinematics.tendon.rod_chain import ElementChain, chain_of, local_twists
from contid.kinematics.tendon.rod_elements import RodElements, TendonEquilibrium
from contid.targets import Vec3

#: Newton steps at most.
_STEPS: Final = 60
#: In equilibrium the moments left over are below this share of the largest stiffness times a radian.
_EXACT: Final = 1e-11
#: Trust region of a Newton step: no element turns by more than this [rad], none stretches by a larger share.
_LARGEST: Final = 0.3


@dataclass(frozen=True, eq=False)
class _Balance:
    """Virtual work of a strain ``(elements, 4)``, flattened, and what it was computed from.

    Attributes:
        left: moments and forces left over, ``(4 elements,)``; 0 in equilibrium [N m].
        stiffness: derivative of ``left`` by the strain, ``(4 elements, 4 elements)``.
        tensions: of the tendons [N].
        by_pull: derivative of ``left`` by the pulls, ``(4 elements, tendons)``.
        chain: the elements in the base frame.
        tip: in the base frame [m].
    """

    left: Array
    stiffness: Array
    tensions: Array
    by_pull: Array
    chain: ElementChain
    tip: Array


def solve(rod: RodElements, pulls: Array, tip_force_n: Vec3, start: Array | None) -> TendonEquilibrium:
    """See `contid.kinematics.tendon.rod.TendonRod.solve`."""
    count = len(rod.lengths)
    x = np.zeros((count, 4)) if start is None else np.array(start)
    free = np.arange(4) < (4 if rod.stretches else 3)
    free = np.tile(free, count)
    force = np.array(tip_force_n)
    scale = float(np.max(rod.stiffness[:, 0]))
    state = _balance(rod, x, pulls, force)
    for _ in range(_STEPS):
        size = float(np.linalg.norm(state.left[free]))
        if size <= _EXACT * scale:
            return _equilibrium(rod, x, state, free)
        step = np.zeros(4 * count)
        step[free] = np.linalg.solve(state.stiffness[np.ix_(free, free)], -state.left[free])
        moved = step.reshape(count, 4)
        share = min(1.0, _LARGEST / max(float(np.abs(moved).max()), 1e-300))
        while True:
            after = _balance(rod, x + share * moved, pulls, force)
            smaller = float(np.linalg.norm(after.left[free])) < (1.0 - 1e-4 * share) * size
            if smaller or share < 1e-4:
                break
            share *= 0.5
        x, state = x + share * moved, after
    size = float(np.linalg.norm(state.left[free]))
    if size <= 1e4 * _EXACT * scale:
        return _equilibrium(rod, x, state, free)
    raise ArithmeticError(f"no equilibrium of the rod found: {size:.3g} N m are left over")


def _balance(rod: RodElements, x: Array, pulls: Array, force: Array) -> _Balance:
    """Virtual work of a strain ``(elements, 4)`` (bend u, v, twist, stretch) and its derivative."""
    count = len(rod.lengths)
    chain = chain_of(x, rod.lengths, rod.rigid, rod.base_m)
    tip = chain.points[-1] + chain.rotations[-1] @ rod.offset
    # Weight of an element: half at each of its ends.
    weights = np.zeros((count + 1, 3))
    half = 0.5 * rod.weight
    weights[:-1] += half
    weights[1:] += half
    # Wrench of all loads beyond the start of each element, about the origin of the base frame.
    forces = np.cumsum(weights[:0:-1], axis=0)[::-1] + force
    moments = np.cumsum(np.cross(chain.points[:0:-1], weights[:0:-1]), axis=0)[::-1] + np.cross(tip, force)
    load = np.einsum("ekj,ej->ek", chain.axes, moments) + np.einsum("ekj,ej->ek", chain.shifts, forces)
    # Tendons.
    h = rod.lengths[:, None]
    along = 1.0 + x[:, 3:] - np.einsum("eij,ej->ei", rod.arms, x[:, :2]) / h
    around2 = np.sum(rod.arms**2, axis=-1) / h**2
    root = np.sqrt(along**2 + around2 * x[:, 2:3] ** 2)
    passes = ~np.isnan(root)
    ratio = np.where(passes, along / root, 0.0)
    arms = np.where(passes[:, :, None], rod.arms, 0.0)
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
    k = rod.tendon
    tensions = rod.rest + k * (np.asarray(pulls) - shortening)
    taut = tensions > 0.0
    tensions = np.where(taut, tensions, 0.0)
    everywhere = np.broadcast_to(tensions, root.shape)  # no friction
    left = rod.stiffness * x + np.einsum("ei,eik->ek", everywhere, dl) - load
    # Derivative: stiffness, tendons that stretch, their change of direction by twist, loads that turn.
    size = 4 * count
    flat = dl.transpose(0, 2, 1).reshape(size, -1)
    by_pull = flat * np.where(taut, k, 0.0)
    stiffness = np.diag(rod.stiffness.ravel()) + by_pull @ flat.T
    by_element = stiffness.reshape(count, 4, count, 4)
    own = np.arange(count)
    by_element[own, :, own, :] += _second_of_lengths(everywhere, arms, x[:, 2:3], around2, ratio, root, h)
    axes = chain.axes.reshape(size, 3)
    # d/dx_e of the work of a load on x_f, e before f: the axis of e turns what f moves.
    moved = np.cross(chain.shifts.reshape(size, 3), np.repeat(forces, 4, axis=0)) + _turned_loads(
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
        spin, local, _, _ = local_twists(moved_x, rod.lengths)
        axes_by = np.einsum("eij,ekj->eki", chain.rotations[:-1], spin.imag / 1e-30)
        shifts_by = np.einsum("eij,ekj->eki", chain.rotations[:-1], local.imag / 1e-30)
        shifts_by += np.cross(chain.points[:-1, None, :], axes_by)
        same[:, :, n] -= np.einsum("ekj,ej->ek", axes_by, moments)
        same[:, :, n] -= np.einsum("ekj,ej->ek", shifts_by, forces)
    stiffness += upper + upper.T
    by_element[own, :, own, :] += same
    return _Balance(left.ravel(), stiffness, tensions, by_pull, chain, tip)


def _second_of_lengths(
    tensions: Array, arms: Array, twist: Array, around2: Array, ratio: Array, root: Array, h: Array
) -> Array:
    """Tensions times second derivatives of the tendons' lengths in their elements, ``(elements, 4, 4)``."""
    by_along = tensions * h * around2 * twist**2 / root**3
    mixed = -tensions * h * ratio * around2 * twist / root**2
    by_twist = tensions * h * around2 * ratio**2 / root
    along = np.stack(
        (-arms[:, :, 0] / h, -arms[:, :, 1] / h, np.zeros_like(root), np.ones_like(root)), axis=2
    )
    along = np.where((around2 > 0.0)[:, :, None], along, 0.0)
    turn = np.zeros_like(along)
    turn[:, :, 2] = 1.0
    second = np.einsum("ei,eik,eil->ekl", by_along, along, along)
    cross = np.einsum("ei,eik,eil->ekl", mixed, along, turn)
    second += cross + cross.transpose(0, 2, 1) + np.einsum("ei,eik,eil->ekl", by_twist, turn, turn)
    return np.asarray(second)


def _turned_loads(axes: Array, chain: ElementChain, weights: Array, force: Array, tip: Array) -> Array:
    """Sum over the loads beyond an element of ``(axis x point) x load``, ``(4 elements, 3)``."""
    # (a x p) x f = p (a . f) - a (p . f)
    outer = np.einsum("ni,nj->nij", chain.points[1:], weights[1:])[::-1].cumsum(axis=0)[::-1]
    outer = outer + np.outer(tip, force)
    turned: Array = (
        np.einsum("eij,ekj->eki", outer, axes) - axes * np.trace(outer, axis1=1, axis2=2)[:, None, None]
    )
    return turned.reshape(-1, 3)


def _equilibrium(rod: RodElements, x: Array, state: _Balance, free: NDArray[np.bool_]) -> TendonEquilibrium:
    chain = state.chain
    size = 4 * len(rod.lengths)
    axes, shifts = chain.axes.reshape(size, 3), chain.shifts.reshape(size, 3)
    tip_by_x = np.cross(axes, state.tip) + shifts
    tip_by_x = tip_by_x[free]
    inverse = np.linalg.solve(
        state.stiffness[np.ix_(free, free)], np.hstack((-state.by_pull[free], tip_by_x))
    )
    by_pull, by_force = inverse[:, :-3], inverse[:, -3:]
    ends = chain.points[rod.per_section :: rod.per_section]
    return TendonEquilibrium(
        chain.points, state.tip, chain.rotations[-1], ends, state.tensions, x,
        tip_by_x.T @ by_pull, tip_by_x.T @ by_force,
    )  # fmt: skip
