"""Inverse kinematics by shape (Singh et al., IROS 2018): six tube lengths from the pose of the tip alone.

One quintic from the base to the tip represents the whole arm; the tubes are its offset curves. The backbone
length and the split between the sections may be known (measured, or from a model) or not (then: end speed =
mean speed, and the split of the geometry).

When comparing methods: this one uses the *direction* of the tip, a Newton-Raphson solver of the position does
not. A tip pose (five degrees of freedom) does not determine six lengths, but nearly their sums over the
sections.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from contid.kernels import load
from contid.targets import Vec3


@dataclass(frozen=True, slots=True)
class TubeSection:
    """Where the tubes of one section run: distance from the backbone [m] and directions [rad]."""

    distance_m: float
    angles_rad: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ShapeSolution:
    """Answer of the inverse kinematics by shape.

    Attributes:
        lengths_m: tube lengths, section by section [m].
        length_met: False when the given backbone length was ignored: no curve has it, or it would fold the
            arm (`contid.kinematics.ph.ends.plausible_energy`).
    """

    lengths_m: tuple[float, ...]
    length_met: bool


class ShapeInverse:
    """Tube lengths of one arm that starts along +z, by the kernel ``ph_curve``.

    Args:
        sections: tubes of each section, from the base on.
        split: share of each section in the backbone length; must sum to 1.

    Raises:
        KernelMissingError: It is not compiled in this installation.
    """

    def __init__(self, sections: Sequence[TubeSection], split: Sequence[float]) -> None:
        self._kernel = load("ph_curve").ShapeInverse(
            [section.distance_m for section in sections],
            [list(section.angles_rad) for section in sections],
            list(split),
        )

    def solve(self, tip_m: Vec3, direction: Vec3, length_m: float | None = None) -> ShapeSolution:
        """Tube lengths for the pose of the tip.

        Args:
            tip_m: tip position in the base frame [m].
            direction: tangent at the tip in the base frame.
            length_m: backbone length, known to about 1 % [m], or None when unknown.
        """
        found = self._kernel.solve(*tip_m, *direction, math.nan if length_m is None else length_m)
        return ShapeSolution(found.lengths_m, found.length_met)
