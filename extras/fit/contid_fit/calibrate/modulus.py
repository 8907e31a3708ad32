"""Modulus polynomial of a pneumatic section from elongation and pressure, bending gain from bending angles.

With all six chambers (area A_c each) at the pressure x the section (silicone area A) stretches by the strain
``e = 6 x A_c / (E(x) A)`` (eq. 18), so every measured elongation gives a modulus (eq. 19). The polynomial
E(x) (eq. 20) is fitted so that the *elongations* agree best; a fit of the moduli would be dominated by low
pressures, where they are quotients of small numbers.

The bending gain scales the moment of the pressure: without load the bending angle is proportional to it.

Source: Shi et al., section II-E and III-C.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.cosserat.section import MPA_PER_PA, Section
from contid_fit.calibrate.elongation_data import ElongationReading, elongations

#: A polynomial of fourth order needs this many different pressures.
MIN_PRESSURES: Final = 5
#: Distance of the clamp from the end of the range where elongation grows with pressure [bar].
MONOTONE_MARGIN_BAR: Final = 0.05


@dataclass(frozen=True, slots=True)
class ModulusFit:
    """Fit of one section and its quality.

    Attributes:
        section: its number, from 1.
        modulus_pa: b1..b5 of eq. 20 (x in bar, E in Pa).
        measured_to_bar: highest average pressure in the data.
        grows_to_bar: end of the range where the fitted elongation grows with pressure (inf: none found).
        up_to_bar: where to clamp x: the smaller of the two, with a margin to the second.
        levels, trials, readings: number of different pressures, of trials, and of elongations used.
        rmse_modulus_pa: error of the modulus, over the mean of all trials at each pressure (the paper's
            figure).
        rmse_elongation_mm: error of the elongation, over all readings.
        bending_gain: measured bending angle divided by that of the model; None without bending angles.
        rmse_bend_deg: error of the bending angles with this gain; None without them.
        bends: number of bending angles used.
    """

    section: int
    modulus_pa: tuple[float, float, float, float, float]
    measured_to_bar: float
    grows_to_bar: float
    up_to_bar: float
    levels: int
    trials: int
    readings: int
    rmse_modulus_pa: float
    rmse_elongation_mm: float
    bending_gain: float | None = None
    rmse_bend_deg: float | None = None
    bends: int = 0


def fit(section: Section, number: int, readings: Sequence[ElongationReading]) -> ModulusFit:
    """Fit one section.

    Args:
        section: its dimensions; its modulus and gain are not used.
        number: number of the section, from 1; readings of others are ignored.
        readings: see `contid_fit.calibrate.elongation_data`.

    Raises:
        ContidError: too few different pressures, or no positive modulus fits the elongations.
    """
    stretched = elongations(readings, number)
    x = np.array([reading.average_bar for reading in stretched])
    elongation = np.array([reading.elongation_mm for reading in stretched], float)
    levels = np.unique(np.round(x, 3))
    if len(levels) < MIN_PRESSURES:
        raise ContidError(
            f"section {number}: elongations at {len(levels)} different pressures above 0 bar; a polynomial "
            f"of fourth order needs {MIN_PRESSURES} or more"
        )
    if np.any(elongation <= 0.0):
        worst = stretched[int(np.argmin(elongation))]
        raise ContidError(
            f"line {worst.line}: {worst.elongation_mm:g} mm of elongation at {worst.average_bar:g} bar; a "
            "pressurised section gets longer, so check the zero of the measurement"
        )
    stress = axial_stress_pa(section, x)
    coefficients = _fit(x, stress, elongation / section.length)
    modulus = np.polyval(coefficients, x)
    predicted = section.length * stress / modulus
    measured_to = float(x.max())
    # The polynomial is used a little beyond the data at most; its shape farther away does not matter.
    grows_to = growing_range(coefficients, max(2.0 * measured_to, measured_to + 1.0))
    if grows_to < measured_to:
        raise ContidError(
            f"section {number}: the fitted elongation stops growing at {grows_to:.3g} bar, inside the "
            f"measured range up to {measured_to:.3g} bar; measure more pressures or remove outliers"
        )
    result = ModulusFit(
        section=number,
        modulus_pa=tuple(coefficients.tolist()),
        measured_to_bar=measured_to,
        grows_to_bar=grows_to,
        up_to_bar=min(measured_to, grows_to - MONOTONE_MARGIN_BAR),
        levels=len(levels),
        trials=len({reading.trial for reading in stretched}),
        readings=len(stretched),
        rmse_modulus_pa=_mean_modulus_rmse(x, stress, elongation / section.length, levels, coefficients),
        rmse_elongation_mm=float(np.sqrt(np.mean((predicted - elongation) ** 2))),
    )
    bent = [reading for reading in readings if reading.section == number and reading.bend_deg is not None]
    return _with_gain(section, result, bent) if bent else result


def axial_stress_pa(section: Section, average_bar: Array) -> Array:
    """Axial stress of a section with all chambers at one pressure [Pa] (numerator of eq. 18)."""
    return 3.0 * section.pair_force * average_bar / section.area / MPA_PER_PA


def _fit(x: Array, stress: Array, strain: Array) -> Array:
    """Least squares of the strains ``stress / E(x)``: weighted on the moduli first, then Gauss-Newton."""
    powers = np.vander(x, 5)
    weight = strain**2 / stress
    coefficients: NDArray[Any] = np.linalg.lstsq(
        powers * weight[:, None], stress / strain * weight, rcond=None
    )[0]
    for _ in range(30):
        modulus = powers @ coefficients
        if np.any(modulus <= 0.0):
            break
        error = stress / modulus - strain
        step = np.linalg.lstsq(powers * (stress / modulus**2)[:, None], error, rcond=None)[0]
        coefficients = coefficients + step
        if np.abs(step).max() < 1e-10 * np.abs(coefficients).max():
            return coefficients
    raise ContidError("the elongations do not fit any positive modulus; check units and signs")


def growing_range(coefficients: Array, up_to_bar: float) -> float:
    """Smallest x below ``up_to_bar`` at which ``x / E(x)`` stops growing or E becomes negative [bar].

    Infinite when there is none.
    """
    derivative = np.polyder(coefficients)
    # x / E(x) grows while E - x E' > 0.
    slope_sign = np.polysub(coefficients, np.polymul(derivative, [1.0, 0.0]))
    ends = [
        float(root.real)
        for poly in (coefficients, slope_sign)
        for root in np.roots(poly)
        if abs(root.imag) < 1e-9 * (1.0 + abs(root.real)) and 0.0 < root.real <= up_to_bar
    ]
    return min(ends, default=math.inf)


def _mean_modulus_rmse(x: Array, stress: Array, strain: Array, levels: Array, coefficients: Array) -> float:
    errors = []
    for level in levels:
        here = np.round(x, 3) == level
        measured = float(np.mean(stress[here])) / float(np.mean(strain[here]))
        errors.append(measured - float(np.polyval(coefficients, np.mean(x[here]))))
    return float(np.sqrt(np.mean(np.square(errors))))


def _with_gain(section: Section, result: ModulusFit, bent: Sequence[ElongationReading]) -> ModulusFit:
    plain = replace(
        section, modulus_pa=result.modulus_pa, modulus_up_to_bar=result.up_to_bar, bending_gain=1.0
    )
    by_model = np.array([bending_deg(plain, np.array(reading.pressures_bar)) for reading in bent])
    measured = np.array([reading.bend_deg for reading in bent], float)
    if not np.any(by_model > 1.0):  # [deg]
        raise ContidError(
            f"section {result.section}: bending angles need unequal pressures; every row with bend_deg has "
            "(nearly) equal ones"
        )
    gain = float(by_model @ measured / (by_model @ by_model))
    error = gain * by_model - measured
    rmse_deg = float(np.sqrt(np.mean(error**2)))
    return replace(result, bending_gain=gain, rmse_bend_deg=rmse_deg, bends=len(bent))


def bending_deg(section: Section, pressures_bar: Array) -> float:
    """Bending angle of the unloaded section [deg]."""
    return math.degrees(float(np.linalg.norm(section.inflated(pressures_bar).curvature)) * section.length)
