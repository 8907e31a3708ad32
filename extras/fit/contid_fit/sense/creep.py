"""Creep: a soft arm goes on bending for minutes after its pressures stand.

The modulus of silicone falls with the logarithm of the time under load, by the same part in every decade::

    E(age) = E(1 s) (1 - creep log10(age / 1 s))

Age is the time since the last command changed. How fast a tip drifts while the arm rests, over the decades of
its age, gives the creep; what differs from rest to rest, by the poses before, is its standard deviation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array

#: Standard deviation of the creep of an arm before a calibration, per decade.
PRIOR: Final = 0.03
#: The age of a pose that models are for, and the least one: while an arm moves it is no older [s].
REFERENCE_S: Final = 1.0
_LEAST_S: Final = 0.3


@dataclass(frozen=True, eq=False, slots=True)
class Drifts:
    """How tips drifted at the rests of a calibration.

    Attributes:
        decades: mean `decades_of` the ages of the measurements of each rest, shape ``(n,)``.
        slopes: of the tips [m per decade], shape ``(n, 3)``.
        sigma: standard deviation of a component of each slope by the noise [m per decade], shape ``(n,)``.
    """

    decades: Array
    slopes: Array
    sigma: Array

    @classmethod
    def of(cls, rests: list[tuple[Array, Array]], noise_m: float) -> Drifts:
        """From ages [s], shape ``(k,)``, and tips [m], shape ``(k, 3)``, of each rest."""
        decades, slopes, sigma = [], [], []
        for ages_s, tips in rests:
            each = np.array([decades_of(age_s) for age_s in ages_s.tolist()])
            away = each - each.mean()
            spread = max(float(away @ away), 1e-12)
            decades.append(float(each.mean()))
            slopes.append(away @ tips / spread)
            sigma.append(noise_m / math.sqrt(spread))
        return cls(np.array(decades), np.array(slopes), np.array(sigma))


@dataclass(frozen=True, slots=True)
class Creep:
    """The creep of an arm.

    Attributes:
        per_decade: part of the modulus that a decade of time takes.
        sigma: standard deviation of it at one rest.
    """

    per_decade: float = 0.0
    sigma: float = 0.0


def decades_of(age_s: float) -> float:
    """Decades of the age of a pose beyond that which models are for."""
    return math.log10(max(age_s, _LEAST_S) / REFERENCE_S)


def creep_of(by_modulus: Array, drifts: Drifts) -> Creep:
    """The creep under which the model drifts as the tips did.

    Args:
        by_modulus: derivative of each tip by the moduli of all sections together [m], shape ``(n, 3)``.
        drifts: of the same rests.
    """
    size = np.maximum((by_modulus**2).sum(axis=1), 1e-18)
    # Least squares of slope = -creep by_modulus, rest by rest.
    found = -(by_modulus * drifts.slopes).sum(axis=1) / size
    noise = drifts.sigma**2 / size
    scatter = 0.0
    mean = 0.0
    for _ in range(20):
        weights = 1.0 / (noise + scatter)
        mean = float(weights @ found / (weights.sum() + 1.0 / PRIOR**2))
        # What the rests differ by beyond the noise (DerSimonian and Laird).
        plain = 1.0 / noise
        excess = float(plain @ (found - mean) ** 2) - (len(found) - 1)
        scatter = max(0.0, excess / float(plain.sum() - (plain**2).sum() / plain.sum()))
    weights = 1.0 / (noise + scatter)
    return Creep(mean, math.sqrt(1.0 / (float(weights.sum()) + 1.0 / PRIOR**2) + scatter))
