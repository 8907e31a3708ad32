"""The identified error of a pneumatic arm in its model: other sections, and the pressures in its chambers.

    chamber = p + offset + gain (p - middle)

p is the pressure of a regulator [Pa outside, bar in the model]. The side of a hysteresis loop is left out: it
depends on the way. Without an error chambers have the pressures of their regulators, bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from contid.kinematics.array import Array
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.pneumatic.geometry import SectionGeometry
from contid.targets import Actuation
from contid.units import BAR


def scaled_sections(
    sections: Sequence[SectionGeometry], modulus: Sequence[float], moment: Sequence[float]
) -> tuple[SectionGeometry, ...]:
    """Sections with other moduli and moments.

    Args:
        sections: dimensions of the sections in a robot file.
        modulus: for each section, the part by which its modulus is greater.
        moment: for each section, the part by which its pressure moment is greater.
    """
    return tuple(
        section.model_copy(
            update={
                "modulus_pa": tuple((1.0 + float(e)) * b for b in section.modulus_pa),
                "bending_gain": (1.0 + float(m)) * section.bending_gain,
            }
        )
        for section, e, m in zip(sections, modulus, moment, strict=True)
    )


def scaled_arm(robot: Cosserat, modulus: Sequence[float], moment: Sequence[float]) -> Cosserat:
    """An arm with other moduli and moments than ``geometry`` has; no identified error counts.

    Args:
        robot: its description.
        modulus: for each section, the part by which its modulus is greater.
        moment: for each section, the part by which its pressure moment is greater.
    """
    sections = scaled_sections(robot.geometry.sections, modulus, moment)
    geometry = robot.geometry.model_copy(update={"sections": sections})
    return robot.model_copy(update={"geometry": geometry, "sense": None, "load": "known"})


def identified_sections(robot: Cosserat) -> tuple[SectionGeometry, ...]:
    """Sections of the model: those of the file, with its identified error where that corrects the robot."""
    error = robot.correction
    sections = robot.geometry.sections
    return sections if error is None else scaled_sections(sections, error.modulus, error.moment)


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
        if self._lines is None:
            return tuple([p * BAR for p in chambers])
        return tuple(
            [
                min(max((p - shift) / slope * BAR, low), high)
                for p, (slope, shift), low, high in zip(
                    chambers, self._lines, self._lower, self._upper, strict=True
                )
            ]
        )

    def chamber_rows(self, actuations: Array) -> Array:
        """`chambers` of many rows, shape ``(n, k)``."""
        rows: Array = actuations / BAR
        return rows if self._lines is None else self.slopes * rows + self._shifts

    def command_rows(self, chambers: Array) -> Array:
        """`commands` of many rows, shape ``(n, k)``."""
        if self._lines is None:
            return chambers * BAR
        return np.clip((chambers - self._shifts) / self.slopes * BAR, self._lower, self._upper)
