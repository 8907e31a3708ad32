"""The limits that several lengths of a chain share: racks through all sections, and the bend of a section.

The same limits as in `contid.kinematics.arc.feasible`, one posture at a time and without arrays: the control
loop asks in every tick.
"""

from __future__ import annotations

import math

from contid.kinematics.arc.feasible import Feasible
from contid.targets import Actuation


class SharedLengths:
    """Shared limits of a chain: three racks where they have a budget, then a bend per section."""

    def __init__(self, feasible: Feasible) -> None:
        self._sections = feasible.sections.count
        self._rack_m = feasible.rack_m
        self._racks = 3 if feasible.rack_m < math.inf else 0
        self._curvature_max = feasible.curvature_max
        self._to_arc = [
            tuple(tuple(row) for row in matrix)
            for matrix in feasible.sections.to_arc.tolist()
            if feasible.curvature_max < math.inf
        ]
        self._radius_m = feasible.sections.radius_m

    def excess(self, lengths: Actuation, /) -> list[float]:
        """By how much every limit is exceeded [m], negative inside; convex."""
        found = [sum(lengths[j::3]) - self._rack_m for j in range(self._racks)]
        for number, radius_m in enumerate(self._radius_m[: len(self._to_arc)]):
            u, v, length_m = self._arc(lengths, number)
            found.append(radius_m * (math.hypot(u, v) - self._curvature_max * length_m))
        return found

    def gradient(self, lengths: Actuation, number: int, /) -> list[float]:
        """Derivative of one excess by the lengths."""
        found = [0.0] * (3 * self._sections)
        if number < self._racks:
            found[number::3] = [1.0] * self._sections
            return found
        section = number - self._racks
        u, v, _ = self._arc(lengths, section)
        theta = math.hypot(u, v) or 1.0
        by_u, by_v, by_length = self._to_arc[section]
        found[3 * section : 3 * section + 3] = [
            self._radius_m[section] * (u / theta * a + v / theta * b - self._curvature_max * c)
            for a, b, c in zip(by_u, by_v, by_length, strict=True)
        ]
        return found

    def _arc(self, lengths: Actuation, section: int) -> tuple[float, float, float]:
        first, second, third = lengths[3 * section : 3 * section + 3]
        u, v, length_m = (a * first + b * second + c * third for a, b, c in self._to_arc[section])
        return u, v, length_m
