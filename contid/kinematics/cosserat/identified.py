"""The identified error of a pneumatic arm in its model: other sections, and the pressures in its chambers.

    chamber = p + offset + gain (p - middle)

p is the pressure of a regulator [Pa outside, bar in the model]. The side of a hysteresis loop is left out: it
depends on the way. Without an error chambers have the pressures of their regulators, bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.pneumatic.geometry import SectionGeometry
from contid.robot_file.pneumatic.sense import ModelErrors
from contid.targets import Actuation
from contid.units import BAR


@dataclass(frozen=True, slots=True)
class SectionErrors:
    """By what sections differ from their description; one number a section, or none.

    Attributes:
        modulus: part by which the modulus is greater.
        moment: part by which the pressure moment is greater.
        density_kg_m3: added to the density.
        link_mass_g: added to the mass of the link.
    """

    modulus: Sequence[float]
    moment: Sequence[float]
    density_kg_m3: Sequence[float] = ()
    link_mass_g: Sequence[float] = ()

    def applied(self, sections: Sequence[SectionGeometry]) -> tuple[SectionGeometry, ...]:
        """Sections with these errors."""
        none = (0.0,) * len(sections)
        densities, links = self.density_kg_m3 or none, self.link_mass_g or none
        return tuple(
            section.model_copy(
                update={
                    "modulus_pa": tuple((1.0 + e) * b for b in section.modulus_pa),
                    "bending_gain": (1.0 + m) * section.bending_gain,
                    "density_kg_m3": section.density_kg_m3 + density,
                    "link_mass_g": section.link_mass_g + link,
                }
            )
            for section, e, m, density, link in zip(
                sections, self.modulus, self.moment, densities, links, strict=True
            )
        )

    @classmethod
    def of(cls, numbers: Sequence[float], sections: int) -> SectionErrors:
        """From the numbers of `row`."""
        parts = [tuple(numbers[i : i + sections]) for i in range(0, len(numbers), sections)]
        return cls(*parts)

    @property
    def row(self) -> tuple[float, ...]:
        """Moduli, moments, and, where they are given, densities and masses of links."""
        return (*self.modulus, *self.moment, *self.density_kg_m3, *self.link_mass_g)


def scaled_arm(robot: Cosserat, errors: SectionErrors) -> Cosserat:
    """An arm with other sections than ``geometry`` has; no identified error counts."""
    sections = errors.applied(robot.geometry.sections)
    geometry = robot.geometry.model_copy(update={"sections": sections})
    return robot.model_copy(update={"geometry": geometry, "sense": None, "load": "known"})


def identified_sections(robot: Cosserat) -> tuple[SectionGeometry, ...]:
    """Sections of the model: those of the file, with its identified error where that corrects the robot."""
    error = robot.correction
    sections = robot.geometry.sections
    return sections if error is None else section_errors(error).applied(sections)


def section_errors(error: ModelErrors) -> SectionErrors:
    """The errors of sections in a calibration."""
    return SectionErrors(error.modulus, error.moment, error.density_kg_m3, error.link_mass_g)


class Regulators:
    """From the pressures of regulators [Pa] to those of chambers [bar], and back.

    Args:
        robot: its description.

    Attributes:
        slopes: derivative of the pressure of a chamber by that of its regulator, shape ``(k,)``.
    """

    def __init__(self, robot: Cosserat) -> None:
        self._lower, self._upper = robot.lower, robot.upper
        error = robot.correction
        self._lines: list[tuple[float, float]] | None = None
        self.slopes: Array = np.ones(len(robot.axis_names))
        self._shifts = np.zeros(len(robot.axis_names))
        if error is not None:
            middle = 0.5 * (np.array(robot.lower) + np.array(robot.upper)) / BAR
            self.slopes = 1.0 + np.array(error.gain)
            self._shifts = np.array(error.offset_bar) - np.array(error.gain) * middle
            self._lines = list(zip(self.slopes.tolist(), self._shifts.tolist(), strict=True))

    def chambers(self, actuation: Sequence[float]) -> list[float]:
        """Pressures in the chambers [bar] at pressures of the regulators [Pa]."""
        return self.at_bar([p / BAR for p in actuation])

    def at_bar(self, pressures: list[float]) -> list[float]:
        """Pressures in the chambers at pressures of the regulators, both in bar."""
        if self._lines is None:
            return pressures
        return [slope * p + shift for p, (slope, shift) in zip(pressures, self._lines, strict=True)]

    def commands(self, chambers: Sequence[float]) -> Actuation:
        """Pressures of the regulators [Pa] for pressures in the chambers [bar], within the limits."""
        asked = self.asked(chambers)
        if self._lines is None:
            return asked
        ends = zip(asked, self._lower, self._upper, strict=True)
        return tuple([min(max(p, low), high) for p, low, high in ends])

    def asked(self, chambers: Sequence[float]) -> Actuation:
        """`commands` without the limits."""
        if self._lines is None:
            return tuple([p * BAR for p in chambers])
        lines = zip(chambers, self._lines, strict=True)
        return tuple([(p - shift) / slope * BAR for p, (slope, shift) in lines])

    def chamber_rows(self, actuations: Array) -> Array:
        """`chambers` of many rows, shape ``(n, k)``."""
        rows: Array = actuations / BAR
        return rows if self._lines is None else self.slopes * rows + self._shifts

    def command_rows(self, chambers: Array) -> Array:
        """`commands` of many rows, shape ``(n, k)``."""
        if self._lines is None:
            return chambers * BAR
        return np.clip((chambers - self._shifts) / self.slopes * BAR, self._lower, self._upper)
