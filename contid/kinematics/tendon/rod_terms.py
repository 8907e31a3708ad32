"""Terms of the derivative of a rod's equilibrium: tendons, friction, loads carried along."""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.tendon.rod_chain import ElementChain


def capstan_slope(mu: float, tensions: Array, dl: Array, slides: Array, x: Array, bend: Array) -> Array:
    """Derivative of the work of the tendons by the bends before an element, which friction adds up."""
    size = x.size
    if not mu or not np.any(slides):
        return np.zeros((size, size))
    count = len(bend)
    work = -mu * np.einsum("ei,i,eik->ek", tensions, slides, dl).ravel()
    by_bend = np.zeros((count, 4))
    by_bend[:, :2] = x[:, :2] / np.maximum(bend, 1e-300)[:, None]
    element = np.repeat(np.arange(count), 4)
    before = (element[:, None] > element[None, :]) + 0.5 * (element[:, None] == element[None, :])
    derivative: Array = work[:, None] * before * by_bend.ravel()[None, :]
    return derivative


def second_of_lengths(
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


def turned_loads(axes: Array, chain: ElementChain, weights: Array, force: Array, tip: Array) -> Array:
    """Sum over the loads beyond an element of ``(axis x point) x load``, ``(4 elements, 3)``."""
    # (a x p) x f = p (a . f) - a (p . f)
    outer = np.einsum("ni,nj->nij", chain.points[1:], weights[1:])[::-1].cumsum(axis=0)[::-1]
    outer = outer + np.outer(tip, force)
    turned: Array = (
        np.einsum("eij,ekj->eki", outer, axes) - axes * np.trace(outer, axis1=1, axis2=2)[:, None, None]
    )
    return turned.reshape(-1, 3)
