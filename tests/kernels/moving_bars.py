"""Round bars as moving rods."""

from __future__ import annotations

import math

import numpy as np

from contid_dynamics.rod import STRAINS, MovingElements, MovingRod, spread_mass


def elements_of(count: int, length: float, mass_per_m: float, radius: float) -> MovingElements:
    lengths = np.full(count, length / count)
    # The second moment of a full section of this radius is a quarter of its mass times the radius squared.
    middles, ends = spread_mass(lengths, np.full(count, mass_per_m), np.full(count, radius))
    none = np.zeros(0)
    return MovingElements(lengths, np.zeros(count), 3, middles, ends, np.zeros((count, 0, 2)), none, none)


def bar(
    count: int, length: float, radius: float, modulus: float, poisson: float, density: float, damping_s: float
) -> MovingRod:
    """A round bar."""
    inertia = 0.25 * math.pi * radius**4
    h = length / count
    turns = modulus * inertia / h
    stiffness = np.zeros((count, STRAINS))
    stiffness[:, :3] = turns, turns, turns / (1.0 + poisson)
    return MovingRod(elements_of(count, length, density * math.pi * radius**2, radius), stiffness, damping_s)
