"""Forward statics: the base moment that brings a rod with given pressures into balance with its loads.

Newton's method from a given start; which of several equilibria counts is decided in `branch`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from contid.kinematics.cosserat.statics import Sweep, sweep

#: Moment balance at the tip that counts as equilibrium [N·mm].
STATICS_TOLERANCE = 1e-9
#: The same as a part of the moment of all loads, where that is more.
ROUNDING = 1e-12
NEWTON_STEPS = 25


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """A rod in equilibrium, or the best approximation.

    Attributes:
        base_moment: total moment at the base [N·mm].
        sweep: the integration that belongs to it.
        converged: True when the moment balance holds to the tolerance.
    """

    base_moment: Array
    sweep: Sweep
    converged: bool


def newton(
    rod: Rod,
    pressures: Array,
    start: Array,
    loads: Loads,
    elements: int,
    tolerance: float = STATICS_TOLERANCE,
) -> Equilibrium:
    """Newton's method on the base moment, halving steps that make the balance worse."""
    moment = np.array(start, float)
    found = sweep(rod, pressures, moment, loads, elements, tangents=True)
    for _ in range(NEWTON_STEPS):
        error = float(np.linalg.norm(found.moment))
        if error <= tolerance:
            return Equilibrium(moment, found, True)
        assert found.tangents is not None
        try:
            step = np.linalg.solve(found.tangents.moment[:, :3], found.moment)
        except np.linalg.LinAlgError:
            break
        for fraction in (1.0, 0.5, 0.25, 0.125, 0.0625):
            trial = sweep(rod, pressures, moment - fraction * step, loads, elements, tangents=True)
            if np.linalg.norm(trial.moment) < error:
                moment, found = moment - fraction * step, trial
                break
        else:
            break
    return Equilibrium(moment, found, bool(np.linalg.norm(found.moment) <= tolerance))
