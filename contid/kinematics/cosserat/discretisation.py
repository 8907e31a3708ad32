"""How many elements per section a rod needs for a stated error of tip and mid-point."""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.branch import MAX_ELEMENTS, Followed, equilibrium
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from contid.kinematics.cosserat.statics import Sweep, sweep


def discretisation_error(
    rod: Rod, pressures: Array, base_moment: Array, loads: Loads, n: int, here: Sweep
) -> float:
    """Estimated error [mm] of the tip and of the end of the first section of a sweep with n elements.

    From a sweep with two thirds of them: for a method of fourth order the results of n and m < n elements
    differ by ``(n/m)^4 - 1`` times the error of n. The equilibrium of the coarser rod is included to first
    order.
    """
    m = max(1, 2 * n // 3) if n > 1 else 2
    other = sweep(rod, pressures, base_moment, loads, m)
    assert here.tangents is not None
    turn = np.linalg.solve(here.tangents.moment[:, :3], other.moment - here.moment)
    tip = other.tip - here.tip - here.tangents.tip[:, :3] @ turn
    mid = other.ends[0] - here.ends[0] - here.tangents.ends[0][:, :3] @ turn
    return max(float(np.linalg.norm(tip)), float(np.linalg.norm(mid))) / abs((n / m) ** 4 - 1.0)


def is_fine(
    rod: Rod, pressures: Array, base_moment: Array, loads: Loads, elements: int, here: Sweep, error: float
) -> bool:
    """True where the elements of a sweep are enough for an ``error`` [mm], or the most."""
    if elements >= MAX_ELEMENTS:
        return True
    return discretisation_error(rod, pressures, base_moment, loads, elements, here) <= error


def fine_equilibrium(
    rod: Rod, pressures: Array, loads: Loads, elements: int, error: float
) -> tuple[Followed, int]:
    """`branch.equilibrium` with as many elements as ``error`` [mm] demands; also their number.

    Each number of elements follows the path anew: where it passes near a fork, they decide on which side it
    goes on. A branch that ends short of the full load is followed with more elements before that counts.
    """
    while True:
        found = equilibrium(rod, pressures, loads, elements)
        if elements >= MAX_ELEMENTS or loads.is_zero:
            return found, elements
        p, moment = pressures, found.base_moment
        if found.done == 1.0 and is_fine(rod, p, moment, loads, elements, found.sweep, error):
            return found, elements
        elements *= 2
