"""Statics of a loaded rod: integration from base to tip, and its derivatives (the specification).

Eqs. (1)-(11) in total-wrench form: with N = n - F_P and M = m - m_P (wall and fluid together),

    N' = -f,   M' = -p' x N,   p' = R v,   R' = R hat(u),
    v = e3 (1 + strain) + diag(3/EA, 3/EA, 1/EA) R^T N,
    u = curvature + diag(1/EI, 1/EI, 3/EJ) R^T M.

Loads are dead, so N(s) is known and the base moment is the only unknown. The sweep integrates mu = M + p x N,
mu' = -p x f, element by element (`element`). Specification of ``contid/kernels/cosserat/rod.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.element import RodState, link, step
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from contid.kinematics.cosserat.spatial import cross, hat


@dataclass(frozen=True, slots=True)
class Tangents:
    """Derivatives by (base moment, pressures): columns 0..2 and 3.. of every array, shape (3, 3 + 3k).

    Attributes:
        moment: of the moment residual at the tip.
        tip: of the tip position.
        turn: rotation vector of the tip frame, in the base frame.
        ends: of the end of every section.
    """

    moment: Array
    tip: Array
    turn: Array
    ends: tuple[Array, ...]


@dataclass(frozen=True, slots=True)
class Sweep:
    """One integration from base to tip.

    Attributes:
        tip: tip position [mm], shape (3,).
        rotation: tip frame, shape (3, 3).
        ends: end of every section [mm], shape (3,) each.
        moment: residual of the moment balance at the tip [N·mm]; zero in equilibrium.
        turns: turn of the frame by the base moment at every element boundary, base included, shape (3, 3)
            each; empty without tangents.
        tangents: derivatives, if requested.
    """

    tip: Array
    rotation: Array
    ends: tuple[Array, ...]
    moment: Array
    turns: tuple[Array, ...]
    tangents: Tangents | None


def sweep(
    rod: Rod,
    pressures: Array,
    base_moment: Array,
    loads: Loads,
    elements: int = 3,
    tangents: bool = False,
) -> Sweep:
    """Integrate from the clamped base to the tip.

    Args:
        rod: the sections.
        pressures: [bar], shape (3k,).
        base_moment: total moment M at the base [N·mm], shape (3,).
        loads: dead loads.
        elements: steps per section.
        tangents: also integrate the variational equations, one column per unknown. They differ from the
            derivative of the discrete map by the discretisation error, so Newton's method converges linearly
            with a factor of 1e-2 or less.
    """
    columns = 3 + rod.pressures
    dmu = np.zeros((3, columns))
    dmu[:, :3] = np.eye(3)
    state = RodState(
        np.eye(3),
        np.zeros(3),
        np.array(base_moment, float),
        np.zeros((3, columns)),
        np.zeros((3, columns)),
        dmu,
    )
    N = loads.base_force(rod)
    turns = [state.turn[:, :3]]
    ends: list[Array] = []
    end_tangents: list[Array] = []
    for i, section in enumerate(rod.sections):
        inflated = section.inflated(pressures[3 * i : 3 * i + 3])
        f = loads.weight.get(i, np.zeros(3))
        h = section.length / elements
        own = slice(3 + 3 * i, 6 + 3 * i)
        for _ in range(elements):
            state = step(inflated, state, N, f, h, own, tangents)
            N = N - h * f
            turns.append(state.turn[:, :3])
        ends.append(state.p)
        end_tangents.append(state.shift)
        if i in loads.joint_force or i in loads.joint_moment:
            force = loads.joint_force.get(i, np.zeros(3))
            state.mu = state.mu - loads.joint_moment.get(i, np.zeros(3)) - cross(state.p, force)
            state.dmu = state.dmu + hat(force) @ state.shift
            N = N - force
        if section.link > 0.0:
            state = link(state, section.link, loads.link_weight.get(i, np.zeros(3)))
            N = N - section.link * loads.link_weight.get(i, np.zeros(3))
    moment = state.mu - cross(state.p, loads.tip_force) - loads.tip_moment
    derived = None
    if tangents:
        derived = Tangents(
            state.dmu + hat(loads.tip_force) @ state.shift, state.shift, state.turn, tuple(end_tangents)
        )
    return Sweep(
        state.p,
        state.R,
        tuple(ends),
        moment,
        tuple(turns) if tangents else (),
        derived,
    )
