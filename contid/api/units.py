"""The units of the library: those of robot files (mm, bar, deg, N, s), or SI (m, Pa, rad, N, s).

Chosen once per object, with ``si=True``. See docs/decisions/0018-units-of-the-library.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.robot_file.base import Quantity
from contid.units import MM_PER_M


@dataclass(frozen=True, slots=True)
class Units:
    """A choice of units; forces are in N and times in s in both.

    Attributes:
        si: m and Pa instead of mm and bar.
    """

    si: bool = False

    def name(self, quantity: Quantity) -> str:
        """``mm``, ``m``, ``bar`` or ``Pa``: unit of the axes of a robot."""
        if not self.si:
            return quantity.unit
        return {Quantity.LENGTH: "m", Quantity.PRESSURE: "Pa", Quantity.ANGLE: "rad"}[quantity]

    @property
    def length(self) -> str:
        """Unit of positions."""
        return self.name(Quantity.LENGTH)

    def to_si(self, values: Array, quantity: Quantity = Quantity.LENGTH) -> Array:
        """Values of a caller in m or Pa, rounded as those of a file."""
        return values if self.si else _to_si(values, quantity)

    def from_si(self, values: Array, quantity: Quantity = Quantity.LENGTH) -> Array:
        """Values in m or Pa for a caller, rounded as those of a file."""
        return values if self.si else _from_si(values, quantity)

    def change_from_si(self, values: Array, quantity: Quantity = Quantity.LENGTH) -> None:
        """`from_si` in place."""
        if not self.si:
            _from_si(values, quantity, out=values)

    def scale(self, quantity: Quantity = Quantity.LENGTH) -> float:
        """Caller's units per m or Pa, for derivatives."""
        return 1.0 if self.si else quantity.per_si


def _to_si(values: Array, quantity: Quantity) -> Array:
    # The operations of `Quantity.to_si`, so that an array has the bits of a file with the same numbers.
    return values / MM_PER_M if quantity is Quantity.LENGTH else values * quantity.edge_si[1]


def _from_si(values: Array, quantity: Quantity, out: Array | None = None) -> Array:
    if quantity is Quantity.LENGTH:
        return np.multiply(values, MM_PER_M, out=out)
    return np.divide(values, quantity.edge_si[1], out=out)
