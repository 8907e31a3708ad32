"""An equilibrium near a known one, with the derivatives of its tip: a bounded piece of work for every tick.

The specification of ``contid/kernels/cosserat/near.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.branch import load_scale, settle, statics_tolerance
from contid.kinematics.cosserat.compliance import tip_compliance
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod


@dataclass(frozen=True, eq=False, slots=True)
class NearEquilibrium:
    """An equilibrium and how its tip moves.

    Attributes:
        tip: position [mm].
        base_moment: [N·mm].
        by_force: tip by the force on it, shape (3, 3) [mm/N].
        by_pressure: tip by the pressures, shape (3, 3k) [mm/bar].
    """

    tip: Array
    base_moment: Array
    by_force: Array
    by_pressure: Array


def near_equilibrium(
    rod: Rod, pressures: Array, loads: Loads, guess: Array, elements: int
) -> NearEquilibrium | None:
    """The stable equilibrium that Newton's method finds from a base moment [N·mm].

    None where it does not contract from there, or the equilibrium is unstable.
    """
    tolerance = statics_tolerance(load_scale(rod, loads))
    found = settle(rod, pressures, guess, loads, elements, tolerance)
    if found is None:
        return None
    tangents = found.sweep.tangents
    assert tangents is not None
    held = np.linalg.solve(tangents.moment[:, :3], tangents.moment[:, 3:])
    by_pressure = tangents.tip[:, 3:] - tangents.tip[:, :3] @ held
    by_force = tip_compliance(rod, pressures, found.base_moment, loads, elements)
    return NearEquilibrium(found.sweep.tip, found.base_moment, by_force, by_pressure)
