"""Is an equilibrium a minimum of energy? Counting the directions in which it is not, along the rod.

Dead loads do not depend on the shape, so positions can be eliminated and the energy is a functional of the
rotation alone, fixed at the base and free at the tip. Its second variation along the rod is Jacobi's linear
equation for (turn, change of moment). Cut at the element boundaries it becomes a block-tridiagonal quadratic
form with one 3x3 pivot a boundary; by Sylvester's law the negative eigenvalues of all pivots together are the
number of independent ways down. Unlike the sign of det(dM_tip/dM_0), which an axisymmetric rod's double root
leaves unchanged, the count sees every mode (conjugate points with their multiplicity).

It holds for dead forces; a dead moment does not derive from an energy in three dimensions, so moments are
left to the equilibrium and not counted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contid.models.cosserat.equilibrium import equilibrium
from contid.models.cosserat.section import Rod
from contid.models.cosserat.statics import Array, Loads, State, cross, hat, link, step


def _negative(form: Array) -> int:
    """Negative eigenvalues of the symmetric part; the other part is rounding and discretisation."""
    return int(np.count_nonzero(np.linalg.eigvalsh(0.5 * (form + form.T)) < 0.0))


def unstable_modes(rod: Rod, pressures: Array, base_moment: Array, loads: Loads, elements: int = 3) -> int:
    """Number of independent virtual motions that lower the energy; 0 means stable.

    Args:
        rod: the sections.
        pressures: [bar], shape (3k,).
        base_moment: of the equilibrium to judge [N·mm], shape (3,).
        loads: dead loads.
        elements: steps per section; each must be short enough to be stable by itself.
    """
    modes = 0
    N = loads.base_force(rod)
    eye, zero = np.eye(3), np.zeros((3, 3))
    turn, moment = zero, eye
    state = State(eye, np.zeros(3), np.array(base_moment, float), zero, zero, zero)
    first = True
    for i, section in enumerate(rod.sections):
        inflated = section.inflated(pressures[3 * i : 3 * i + 3])
        f = loads.weight.get(i, np.zeros(3))
        h = section.length / elements
        for _ in range(elements):
            # Columns 0..2 continue the fields that start at the base, 3..5 start at this element.
            state.turn = np.hstack([turn, zero])
            state.shift = np.zeros((3, 6))
            state.dmu = np.hstack([moment, eye])
            state = step(inflated, state, N, f, h, None, True)
            N = N - h * f
            ahead, local = state.turn[:, :3], state.turn[:, 3:]
            if not first:
                modes += _negative(np.linalg.solve(local, ahead) @ np.linalg.inv(turn))
            first = False
            turn = ahead
            moment = state.dmu[:, :3] + hat(N) @ state.shift[:, :3]
        force = loads.joint_force.get(i, np.zeros(3))
        state.mu = state.mu - loads.joint_moment.get(i, np.zeros(3)) - cross(state.p, force)
        N = N - force
        if section.link > 0.0:
            f = loads.link_weight.get(i, np.zeros(3))
            state.turn, state.shift, state.dmu = turn, zero, moment - hat(N) @ zero
            state = link(state, section.link, f)
            N = N - section.link * f
            moment = state.dmu + hat(N) @ state.shift
    return modes + _negative(moment @ np.linalg.inv(turn))


def critical_factor(
    rod: Rod,
    pressures: Array,
    loads: Loads,
    most: float = 1.0,
    elements: int = 3,
) -> float | None:
    """Least factor of the tip force at which the branch from the unloaded shape loses its stability.

    Args:
        rod: the sections.
        pressures: [bar].
        loads: dead loads; only the tip force is scaled, the others act in full.
        most: the largest factor looked at.
        elements: steps per section.

    Returns:
        The factor to about one part in a thousand, 0.0 when the others alone are too much, or None when
        the branch is stable up to ``most``.
    """

    def stable(factor: float) -> bool:
        acting = replace(loads, tip_force=factor * loads.tip_force)
        found = equilibrium(rod, pressures, acting, elements)
        if not found.converged:
            return False
        return unstable_modes(rod, pressures, found.base_moment, acting, elements) == 0

    if stable(most):
        return None
    low, high = 0.0, most
    if not stable(0.0):
        return 0.0
    while high - low > 1e-3 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return 0.5 * (low + high)
