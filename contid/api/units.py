"""The units of the library: those of robot files (mm, bar, deg, N, s), or SI (m, Pa, rad, N, s).

Chosen once per object, with ``si=True``. See docs/decisions/0018-units-of-the-library.md.
"""

from __future__ import annotations

from dataclasses import dataclass

from contid.kinematics.array import Array
from contid.robot_file.base import Quantity


@dataclass(frozen=True, slots=True)
class Units:
    """A choice of units; forces are in N and times in s in both.

    Attributes:
        si: m, Pa and rad instead of mm, bar and degrees.
    """

    si: bool = False

    def name(self, quantity: Quantity) -> str:
        """Unit of a quantity: ``mm``, ``bar`` or ``deg``, with ``si`` ``m``, ``Pa`` or ``rad``."""
        if not self.si:
            return quantity.unit
        return {Quantity.LENGTH: "m", Quantity.PRESSURE: "Pa", Quantity.ANGLE: "rad"}[quantity]

    @property
    def length(self) -> str:
        """Unit of positions."""
        return self.name(Quantity.LENGTH)

    def to_si(self, values: Array, quantity: Quantity = Quantity.LENGTH) -> Array:
        """A caller's values in m, Pa or rad, rounded as those of a file; with ``si`` the array itself."""
        return values if self.si else quantity.to_si(values)

    def from_si(self, values: Array, quantity: Quantity = Quantity.LENGTH) -> Array:
        """Values in m, Pa or rad for a caller, rounded as those of a file; with ``si`` the array itself."""
        return values if self.si else quantity.from_si(values)

    def change_from_si(self, values: Array, quantity: Quantity = Quantity.LENGTH) -> None:
        """`from_si` in place."""
        if not self.si:
            divisor, factor = quantity.edge_si
            values /= factor
            values *= divisor

    def scale(self, quantity: Quantity = Quantity.LENGTH) -> float:
        """Caller's units per m, Pa or rad, for derivatives."""
        return 1.0 if self.si else quantity.per_si
