"""Statics of a rod under gravity and wrenches at its middle and tip, against shapes computed by SoRoSim.

Conventions of the data: tests/reference/rod-statics/README.md. The model grows along z: its axes (x, y, z)
are the (y, z, x) of the data.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from contid.kinematics.cosserat.equilibrium import newton
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Inflated, Rod, Section

DATA = Path(__file__).parents[1] / "reference" / "rod-statics"
#: E [Pa], Poisson's ratio, density [kg/m^3], radius [m], length [m].
RODS = {"spring_steel": (200e9, 0.33, 7870.0, 0.8e-3, 0.6), "tpu": (70e6, 0.4, 1200.0, 5e-3, 0.4)}
TO_MODEL = [1, 2, 0]
ELEMENTS = 8
RAMP = (0.25, 0.5, 0.75, 1.0)


class Half:
    """Half of a passive round rod, in the place of a pneumatic section [mm, N]."""

    link = 0.0

    def __init__(self, name: str) -> None:
        modulus, poisson, density, radius, length = RODS[name]
        modulus_mpa, r = modulus * 1e-6, 1e3 * radius
        area, inertia = math.pi * r**2, 0.25 * math.pi * r**4
        shear = modulus_mpa / (2.0 * (1.0 + poisson))
        self.length = 0.5e3 * length
        self.mass_kg_mm = density * area * 1e-9
        self._inflated = Inflated(
            bend=1.0 / (modulus_mpa * inertia),
            twist=1.0 / (shear * 2.0 * inertia),
            shear=1.0 / (shear * area),
            axial=1.0 / (modulus_mpa * area),
            strain=0.0,
            curvature=np.zeros(3),
            strain_per_bar=0.0,
            curvature_per_bar=np.zeros((3, 3)),
            softening=0.0,
        )

    def inflated(self, pressures: np.ndarray) -> Inflated:
        return self._inflated


def shapes(name: str) -> np.ndarray:
    """Shape (shapes, 6, 17): gravity, wrenches at middle and tip, seven stations in each half."""
    rows = (DATA / f"{name}.csv").read_text().splitlines()[2:]
    return np.array([[float(cell) for cell in row.split(",")[1:]] for row in rows]).reshape(-1, 6, 17)


@pytest.mark.parametrize("name", RODS)
def test_middle_and_tip_are_those_of_sorosim(name: str) -> None:
    half, length_mm = Half(name), 1e3 * RODS[name][4]
    rod = Rod(cast("tuple[Section, ...]", (half, half)))
    for shape in shapes(name):
        moments, forces = 1e3 * shape[:3][TO_MODEL], shape[3:][TO_MODEL]
        weight = half.mass_kg_mm * forces[:, 0]
        full = Loads(
            forces[:, 2], moments[:, 2], {0: forces[:, 1]}, {0: moments[:, 1]}, {0: weight, 1: weight}
        )
        base = np.zeros(3)
        for part in RAMP:
            found = newton(rod, np.zeros(6), base, full.scaled(part), ELEMENTS)
            assert found.converged
            base = found.base_moment
        middle, tip = (1e3 * forces[:, column] for column in (9, 16))
        assert float(np.linalg.norm(found.sweep.ends[0] - middle)) <= 1e-3 * length_mm
        assert float(np.linalg.norm(found.sweep.tip - tip)) <= 1e-3 * length_mm
