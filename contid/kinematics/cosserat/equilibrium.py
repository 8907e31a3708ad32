"""Forward statics: the base moment that brings a rod with given pressures into balance with its loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from contid.kinematics.cosserat.spatial import cross
from contid.kinematics.cosserat.statics import Sweep, sweep

#: Moment balance at the tip that counts as equilibrium [N·mm].
STATICS_TOLERANCE = 1e-9
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


def equilibrium(rod: Rod, pressures: Array, loads: Loads, elements: int = 3) -> Equilibrium:
    """Equilibrium on the branch that grows out of the unloaded shape.

    The load is raised from zero in steps that shrink where Newton's method fails: this is the branch of a
    slowly loaded robot. Its stability is not checked: `contid.kinematics.cosserat.stability.unstable_modes`.
    """
    found = newton(rod, pressures, np.zeros(3), loads.scaled(0.0), elements)
    reached, step = 0.0, 0.25
    while reached < 1.0 and step > 1e-3:
        goal = min(1.0, reached + step)
        # The moment a dead tip force has about the base is known as soon as the tip is.
        start = found.base_moment + (goal - reached) * cross(found.sweep.tip, loads.tip_force)
        trial = newton(rod, pressures, start, loads.scaled(goal), elements)
        near = np.linalg.norm(trial.sweep.tip - found.sweep.tip) < 0.3 * rod.reach
        if trial.converged and near:
            found, reached, step = trial, goal, 2.0 * step
        else:
            step *= 0.5
    if reached < 1.0:
        return Equilibrium(found.base_moment, found.sweep, False)
    return found
