"""The quintic through two points with given directions there, with a given length or without.

End data of a continuum body are unit tangents; the size of the end derivatives dominates the result, and
Singh et al. (IROS 2018) do not state it. Here both have the size ``m``, chosen so that

* the curve has a prescribed length S: ``120 S = m K + |120 dp + m G|``, a quadratic in m, or
* the length being unknown, the end speed is the mean speed, ``m = S(m)``, a quadratic too,

with the unit preimages ``a0, a2``, ``k = a0 . a2``, ``K = 30 - 10 k``, ``G = 10 <a0, a2> - 15 (t0 + t1)``.

Two angles are free. ``beta`` turns the end preimage away from the one nearest to the start's, ``gamma`` turns
the middle one. (0, 0) is the minimal rotation and is as good as the least bending-and-twisting energy; a body
that turns by more than 180 degrees in total needs ``beta = pi``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.targets import Vec3
from contid_ropes.ph.lift import NO_TURN, lift, nearest, product, turned
from contid_ropes.ph.quintic import PhQuintic

#: (beta, gamma) of the branches that `least_energy` compares.
BRANCHES: Final = ((0.0, 0.0), (math.pi, 0.0), (0.0, math.pi), (math.pi, math.pi))

# See `plausible_energy`.
_ENERGY_RATIO: Final = 2.0
_ENERGY_ALLOWANCE: Final = 1.0

# Straight and as long as the chord: every m gives that length, and the quadratic is 0/0.
STRAIGHT: Final = 1e-10


@dataclass(frozen=True, slots=True)
class CurveEnds:
    """Two positions [m] and the unit tangents there, both along the direction of travel."""

    start_m: Vec3
    end_m: Vec3
    start_direction: Vec3
    end_direction: Vec3


@dataclass(frozen=True, slots=True)
class PhFit:
    """A curve through given ends.

    Attributes:
        curve: the quintic.
        end_speed_m: size m of the derivative at both ends [m].
        length_met: False when no such curve has the given length; ``note`` is then one sentence about it.
    """

    curve: PhQuintic
    end_speed_m: float
    length_met: bool = True
    note: str = ""

    @property
    def energy_per_m(self) -> float:
        """Bending plus twisting energy for unit stiffness [1/m]."""
        return self.curve.bending_energy + self.curve.twist_energy


def quintic_between(start_m: Array, chord: Array, a0: Array, a2: Array, c: Array, gamma: float) -> PhQuintic:
    """The quintic over a chord with given end preimages, its middle one from ``c = C i C*``."""
    # With beta = pi and parallel tangents a0 + a2 vanishes and leaves the middle open: a0 - a2 then decides.
    both = a0 + a2 if float((a0 + a2) @ (a0 + a2)) > NO_TURN**2 * float(a0 @ a0 + a2 @ a2) else a0 - a2
    middle = turned(nearest(lift(c), both, chord), math.cos(gamma), math.sin(gamma))
    return PhQuintic(start_m, np.stack([a0, (middle - 3.0 * a0 - 3.0 * a2) / 4.0, a2]))


def speed_for_length(chord: Array, G: Array, k: float, length_m: float) -> float:
    """End speed m [m] that gives the length, or nan when no curve of this branch has it.

    ``(|G|^2 - K^2) m^2 + 240 (dp . G + S K) m + 14400 (|dp|^2 - S^2) = 0`` and ``120 S >= m K``.
    """
    K = 30.0 - 10.0 * k
    surplus = (length_m - math.sqrt(float(chord @ chord))) / length_m
    if surplus < -STRAIGHT:
        return math.nan
    if 1.0 - k < STRAIGHT and surplus < STRAIGHT:
        return length_m
    c2 = float(G @ G) - K * K
    c1 = 240.0 * (float(chord @ G) + length_m * K)
    c0 = 14400.0 * (float(chord @ chord) - length_m * length_m)
    discriminant = c1 * c1 - 4.0 * c2 * c0
    if discriminant < 0.0:
        return math.nan
    below = c1 + math.sqrt(discriminant)
    m = -2.0 * c0 / below if below > 0.0 else math.nan
    return m if m > 0.0 and 120.0 * length_m >= m * K * (1.0 - STRAIGHT) else math.nan


def speed_as_mean(chord: Array, G: Array, k: float) -> float:
    """End speed m [m] equal to the length it gives, for a body of unknown length.

    ``(|G|^2 - (90 + 10 k)^2) m^2 + 240 dp . G m + 14400 |dp|^2 = 0``.

    The leading coefficient is negative for all data (|G| <= 40), so there is one positive root.
    """
    c2 = float(G @ G) - (90.0 + 10.0 * k) ** 2
    c1 = 240.0 * float(chord @ G)
    c0 = 14400.0 * float(chord @ chord)
    root = math.sqrt(c1 * c1 - 4.0 * c2 * c0)
    return (-c1 - root) / (2.0 * c2) if c1 >= 0.0 else 2.0 * c0 / (root - c1)


def through(ends: CurveEnds, length_m: float | None = None, beta: float = 0.0, gamma: float = 0.0) -> PhFit:
    """The quintic through the ends, of the given length or, without one, with end speed = mean speed.

    An impossible length (shorter than the chord, or beyond this branch) gives the curve of unknown length,
    with ``length_met`` False.

    Raises:
        ValueError: both ends are one point and there is no length: nothing gives the curve a size.
    """
    start, end = np.array(ends.start_m), np.array(ends.end_m)
    t0, t1 = _unit(ends.start_direction), _unit(ends.end_direction)
    chord = end - start
    a0 = lift(t0)
    a2 = turned(nearest(lift(t1), a0, chord), math.cos(beta), math.sin(beta))
    k = float(a0 @ a2)
    G = 10.0 * product(a0, a2) - 15.0 * (t0 + t1)
    m = math.nan if length_m is None else speed_for_length(chord, G, k, length_m)
    met, note = True, ""
    if math.isnan(m):
        m = speed_as_mean(chord, G, k)
        if m == 0.0:
            raise ValueError("both ends of the curve are one point; it needs a length")
        if length_m is not None:
            met, note = False, _length_note(chord, length_m)
    # The preimages from which m was computed: lifting nearly opposite derivatives again could give others.
    root = math.sqrt(m)
    curve = quintic_between(start, chord, root * a0, root * a2, 120.0 * chord + m * G, gamma)
    return PhFit(curve, m, met, note)


def least_energy(ends: CurveEnds, length_m: float | None = None) -> PhFit:
    """The branch of least bending and twisting energy among beta, gamma of 0 or pi.

    It differs from (0, 0) above 180 degrees of total turning, and for surplus length between nearly parallel
    ends.
    """
    fits = [through(ends, length_m, beta, gamma) for beta, gamma in BRANCHES]
    return min(fits, key=lambda fit: (not fit.length_met, fit.energy_per_m))


def plausible_energy(free: PhFit, length_m: float) -> float:
    """Greatest energy [1/m] of a curve of a length known to about 1 %.

    Twice that of the curve of unknown length between the same ends, and the energy of a turn of one radian.
    Exact data of two-section arms stay below a ratio of 1.2.
    """
    return _ENERGY_RATIO * free.energy_per_m + _ENERGY_ALLOWANCE / length_m


def _unit(direction: Vec3) -> Array:
    vector = np.array(direction, dtype=np.float64)
    result: Array = vector / math.sqrt(float(vector @ vector))
    return result


def _length_note(chord: Array, length_m: float) -> str:
    span = math.sqrt(float(chord @ chord))
    if length_m < span:
        return f"a length of {length_m * 1e3:g} mm is {(span - length_m) * 1e3:.3g} mm shorter than the chord"
    return f"no curve of this branch has the length {length_m * 1e3:g} mm between these directions"
