"""PyElastica's dynamic rod, relaxed to rest, against the statics.

PyElastica clamps in a way that is first order in its element length, so three levels are extrapolated. What
remains is its own constitutive law, forces over the stretch and moments over its cube: a few 1e-4 of it.
"""

from __future__ import annotations

import math

import elastica as ea
import numpy as np
import pytest
import tqdm

from contid.kinematics.array import Array
from contid.kinematics.cosserat.section import Loads, Rod, Section
from tests.kinematics.cosserat_cases import standing

pytestmark = [pytest.mark.slow, pytest.mark.campaign]

LENGTH, RADIUS, YOUNG_PA = 0.2, 0.005, 1e6
AREA, INERTIA = math.pi * RADIUS**2, math.pi * RADIUS**4 / 4.0
ALPHA = 5.0
FORCE = ALPHA * YOUNG_PA * INERTIA / LENGTH**2


def relaxed_tip(elements: int) -> Array:
    """Tip [m] of a clamped rod along z under a transverse force along x, after its motion has died out."""

    class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
        pass

    shear_correction = 27.0 / 28.0  # PyElastica's own; the statics use G A with G = E/3
    rod = ea.CosseratRod.straight_rod(
        elements, np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), LENGTH, RADIUS, 1000.0,
        youngs_modulus=YOUNG_PA, shear_modulus=YOUNG_PA / 3.0 / shear_correction,
    )  # fmt: skip
    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(
        ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    simulator.add_forcing_to(rod).using(
        ea.EndpointForces, np.zeros(3), np.array([FORCE, 0.0, 0.0]), ramp_up_time=0.5
    )
    step = 0.2 * LENGTH / elements / math.sqrt(YOUNG_PA / 1000.0)
    simulator.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=10.0, time_step=step)
    simulator.finalize()
    duration = 6.0
    ea.integrate(ea.PositionVerlet(), simulator, duration, int(duration / step), progress_bar=False)
    assert np.abs(rod.velocity_collection).max() < 1e-5
    tip: Array = rod.position_collection[:, -1].copy()
    return tip


def test_relaxed_dynamic_rod_agrees_with_the_statics(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tqdm.tqdm, "monitor_interval", 0)  # its monitor thread would outlive the test
    coarse, middle, fine = (relaxed_tip(n) for n in (10, 20, 40))
    first, second = 2.0 * middle - coarse, 2.0 * fine - middle
    extrapolated = (4.0 * second - first) / 3.0
    section = Section(
        LENGTH * 1e3,
        0.0,
        AREA * 1e6,
        INERTIA * 1e12,
        2.0 * INERTIA * 1e12,
        4.9,
        4.5,
        (0.0, 0.0, 0.0, 0.0, YOUNG_PA),
    )
    loads = Loads(tip_force=np.array([FORCE, 0.0, 0.0]))
    found = standing(Rod((section,)), np.zeros(3), loads, 64)
    assert found.carried == 1.0
    off = float(np.linalg.norm(found.tip * 1e-3 - extrapolated)) / LENGTH
    print(f"tips differ by {off:.2e} of the length")
    assert off < 1e-3
