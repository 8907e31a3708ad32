"""Compliance of a rod's tip: derivative of its position by a force on it, pressures constant, in equilibrium.

A rod in equilibrium obeys eqs. (1)-(11) in total-wrench form: with N = n - F_P and M = m - m_P (wall and
fluid together),

    N' = -f,   M' = -p' x N,   p' = R v,   R' = R hat(u),
    v = e3 (1 + strain) + diag(3/EA, 3/EA, 1/EA) R^T N,
    u = curvature + diag(1/EI, 1/EI, 3/EJ) R^T M.

Loads are dead, so N(s) is known and the base moment is the only unknown. `sweep` integrates mu = M + p x N,
mu' = -p x f, element by element (`element`), with its derivatives; equilibria come from the kernel.

The compliance follows from the variational equations for the base moment and for the tip force F, which adds
dN = dF to the force in every section and so ``-p x dN`` to dM and ``R diag(3/EA, 3/EA, 1/EA) R^T dN`` to dp'.
They are integrated along the equilibrium by the classical Runge-Kutta method, with the states of half
elements; the moment balance at the tip eliminates the base moment. Symmetric, because the loads have a
potential.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array, pseudo_inverse
from contid.kinematics.cosserat.element import (
    RodState,
    cross,
    hat,
    link,
    shift_rate,
    step,
    strains,
    turn_rate,
)
from contid.kinematics.cosserat.section import Inflated, Loads, Rod


@dataclass(frozen=True, slots=True)
class Sweep:
    """Where a sweep ends.

    Attributes:
        tip: position [mm], shape (3,).
        moment: residual of the moment balance at the tip [N·mm], shape (3,); zero in equilibrium.
        tip_by: derivative of ``tip`` by (base moment, pressures), shape (3, 3 + 3k).
        moment_by: the same of ``moment``.
    """

    tip: Array
    moment: Array
    tip_by: Array
    moment_by: Array


def sweep(rod: Rod, pressures: Array, base_moment: Array, loads: Loads, elements: int) -> Sweep:
    """Integrate from the clamped base to the tip.

    Args:
        rod: the sections.
        pressures: [bar], shape (3k,).
        base_moment: total moment M at the base [N·mm], shape (3,).
        loads: weights and a force on the tip; no moments, nothing at joints.
        elements: steps per section. The derivatives are those of the rod: from those of the discrete map they
            differ by the discretisation error.
    """
    columns = np.zeros((3, 3 + rod.pressures))
    by_moment = columns.copy()
    by_moment[:, :3] = np.eye(3)
    state = RodState(np.eye(3), np.zeros(3), np.array(base_moment, float), columns, columns, by_moment)
    N = loads.base_force(rod)
    for i, section in enumerate(rod.sections):
        inflated = section.inflated(pressures[3 * i : 3 * i + 3])
        f = loads.weight.get(i, np.zeros(3))
        h = section.length / elements
        own = slice(3 + 3 * i, 6 + 3 * i)
        for _ in range(elements):
            state = step(inflated, state, N, f, h, own, True)
            N = N - h * f
        if section.link > 0.0:
            f = loads.link_weight.get(i, np.zeros(3))
            state = link(state, section.link, f)
            N = N - section.link * f
    moment = state.mu - cross(state.p, loads.tip_force)
    return Sweep(state.p, moment, state.shift, state.dmu + hat(loads.tip_force) @ state.shift)


#: Columns: base moment, tip force.
_COLUMNS = 6
#: Derivative of the force in the rod by both.
_FORCE = np.hstack([np.zeros((3, 3)), np.eye(3)])


def tip_compliance(rod: Rod, pressures: Array, base_moment: Array, loads: Loads, elements: int) -> Array:
    """Tip by tip force, shape (3, 3) [mm/N].

    Args:
        rod: the sections.
        pressures: [bar], shape (3k,).
        base_moment: base moment of the equilibrium [N·mm], shape (3,).
        loads: weight and a force on the tip; no moments, nothing at joints.
        elements: steps per section.
    """
    columns = np.zeros((3, _COLUMNS))
    moment = np.hstack([np.eye(3), np.zeros((3, 3))])
    state = RodState(np.eye(3), np.zeros(3), np.array(base_moment, float), columns, columns, moment)
    N = loads.base_force(rod)
    for i, section in enumerate(rod.sections):
        inflated = section.inflated(pressures[3 * i : 3 * i + 3])
        f = loads.weight.get(i, np.zeros(3))
        h = section.length / elements
        for _ in range(elements):
            state = _element(inflated, state, N, f, h)
            N = N - h * f
        if section.link > 0.0:
            f = loads.link_weight.get(i, np.zeros(3))
            state = link(state, section.link, f)
            N = N - section.link * f
    balance = state.dmu + hat(loads.tip_force) @ state.shift - hat(state.p) @ _FORCE
    by_force = -pseudo_inverse(balance[:, :3]) @ balance[:, 3:]
    compliance: Array = state.shift[:, 3:] + state.shift[:, :3] @ by_force
    return compliance


def _element(inflated: Inflated, start: RodState, N: Array, f: Array, h: float) -> RodState:
    """One element: the state by two half steps, the columns by Runge-Kutta over them."""
    middle = step(inflated, start, N, f, 0.5 * h, None, False)
    end = step(inflated, middle, N - 0.5 * h * f, f, 0.5 * h, None, False)
    stages = ((start, 0.0), (middle, 0.5), (middle, 0.5), (end, 1.0))
    total = [np.zeros((3, _COLUMNS)) for _ in range(3)]
    rates: tuple[Array, Array, Array] | None = None
    for (state, part), weight in zip(stages, (1.0, 2.0, 2.0, 1.0), strict=True):
        own = (start.turn, start.shift, start.dmu)
        here = own if rates is None else tuple(a + part * h * b for a, b in zip(own, rates, strict=True))
        rates = _rates(inflated, state, here[0], here[1], here[2], N - part * h * f, f)
        total = [sum_ + weight * rate for sum_, rate in zip(total, rates, strict=True)]
    turn, shift, dmu = (
        a + h / 6.0 * b for a, b in zip((start.turn, start.shift, start.dmu), total, strict=True)
    )
    return RodState(end.R, end.p, end.mu, turn, shift, dmu)


def _rates(
    inflated: Inflated, state: RodState, turn: Array, shift: Array, dmu: Array, N: Array, f: Array
) -> tuple[Array, Array, Array]:
    """Rates of the columns (turn, shift, dmu) at a station."""
    M = state.mu - cross(state.p, N)
    _, v = strains(inflated, state.R, N, M)
    e = state.R[:, 2]
    wrench = dmu + hat(N) @ shift + hat(M) @ turn - hat(state.p) @ _FORCE
    stretch = inflated.shear * _FORCE + (inflated.axial - inflated.shear) * np.outer(e, e @ _FORCE)
    return (
        turn_rate(inflated, e, wrench),
        shift_rate(inflated, e, state.R @ v, N, turn) + stretch,
        hat(f) @ shift,
    )
