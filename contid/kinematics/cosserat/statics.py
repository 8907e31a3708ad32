"""One sweep of a loaded rod from base to tip with its derivatives, for those of an equilibrium.

Eqs. (1)-(11) in total-wrench form: with N = n - F_P and M = m - m_P (wall and fluid together),

    N' = -f,   M' = -p' x N,   p' = R v,   R' = R hat(u),
    v = e3 (1 + strain) + diag(3/EA, 3/EA, 1/EA) R^T N,
    u = curvature + diag(1/EI, 1/EI, 3/EJ) R^T M.

Loads are dead, so N(s) is known and the base moment is the only unknown. The sweep integrates mu = M + p x N,
mu' = -p x f, element by element (`element`). Equilibria come from the kernel.
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
