"""Stability of an equilibrium: the number of directions in which it is not a minimum of energy.

With dead loads the energy is a functional of the rotation alone, fixed at the base and free at the tip. Its
second variation leads to Jacobi's linear equation for (turn, change of moment). Cut at the element boundaries
it is a block-tridiagonal quadratic form, and by Sylvester's law the negative eigenvalues of its 3x3 pivots
add up to the number of unstable modes. With W_i the turns at boundary i of the three fields with a unit
change of moment at the base, the pivot is ``local^-1 W_(i+1) W_i^-1``. The response ``local`` of an element
is positive definite if the element alone is stable, so the signs are those of the eigenvalues of ``W_(i+1)
W_i^-1``. The last pivot is the stiffness ``m W^-1`` at the tip. A negative sign marks a conjugate point, with
its multiplicity; the sign of det(dM_tip/dM_0) misses the double roots of an axisymmetric rod.

A dead moment does not derive from an energy in three dimensions: it enters the equilibrium only.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from contid.kinematics.cosserat.statics import sweep


def unstable_modes(rod: Rod, pressures: Array, base_moment: Array, loads: Loads, elements: int = 3) -> int:
    """Number of independent virtual motions that lower the energy; 0 means stable.

    Args:
        rod: the sections.
        pressures: [bar], shape (3k,).
        base_moment: of the equilibrium to judge [N·mm], shape (3,).
        loads: dead loads.
        elements: steps per section; each must be short enough to be stable by itself.
    """
    found = sweep(rod, pressures, base_moment, loads, elements, tangents=True)
    assert found.tangents is not None
    modes = 0
    for before, after in pairwise(found.turns[1:]):
        # Real eigenvalues up to rounding: the ratio is a positive definite matrix times a symmetric one.
        ratio = np.linalg.eigvals(after @ np.linalg.inv(before))
        modes += int(np.count_nonzero(ratio.real < 0.0))
    stiffness = found.tangents.moment[:, :3] @ np.linalg.inv(found.tangents.turn[:, :3])
    return modes + int(np.count_nonzero(np.linalg.eigvalsh(0.5 * (stiffness + stiffness.T)) < 0.0))
