"""Limits of a robot: the ranges of its axes, and the names behind the bits of ``limited_by``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from contid.kinematics.array import Array
from contid.kinematics.batch import Solutions
from contid.targets import REACH

_SECTIONS: Final = (
    *(f"rack{rack}.length" for rack in (1, 2, 3)),
    *(f"s{section}.bend_radius" for section in range(1, 9)),
    REACH,
)
#: Limits of the models of contid beyond those of single axes, in the order of their bits.
OF_MODELS: Final[dict[str, tuple[str, ...]]] = {
    "rack_finger": ("arc_length.min", "curvature", "no_arc"),
    "tri_rack": _SECTIONS,
    "tri_tube": _SECTIONS,
    "cosserat": ("stability", REACH, "iterations"),
}
BITS: Final = 64


@dataclass(frozen=True, eq=False)
class AxisRanges:
    """Ranges and rates of the axes of a robot, in the units of the library.

    Attributes:
        names: names of the axes, with their unit as in trajectories: ``left_mm``.
        min, max: limits of every axis, shape ``(n,)``.
        rest: rest pose, shape ``(n,)``.
        velocity: maximum speed of an axis, per s.
        acceleration: greatest acceleration, in the axis unit per s^2.
        jerk: greatest jerk, in the axis unit per s^3.
    """

    names: tuple[str, ...]
    min: Array
    max: Array
    rest: Array
    velocity: float
    acceleration: float
    jerk: float


class LimitBits:
    """Bits for names of limits; names of other models join at the end."""

    def __init__(self, model: str, axes: Sequence[str]) -> None:
        own = [f"{axis}.{end}" for end in ("min", "max") for axis in axes]
        names = dict.fromkeys([*own, *OF_MODELS.get(model, ())])
        self._places = {name: place for place, name in enumerate(names)}

    @property
    def names(self) -> tuple[str, ...]:
        """Bit k stands for ``names[k]``."""
        return tuple(self._places)

    def translated(self, solutions: Solutions) -> NDArray[np.uint64]:
        """``limited_by`` of a batch, whose bits have an order of their own, in the order of `names`."""
        bits = solutions.rows["limited_by"]
        translated = np.zeros(len(bits), dtype=np.uint64)
        limited = np.flatnonzero(bits)
        for k, name in enumerate(solutions.limit_names):
            with_this_limit = limited[(bits[limited] >> np.uint64(k)) & np.uint64(1) != 0]
            if len(with_this_limit):
                place = self._places.setdefault(name, len(self._places))
                translated[with_this_limit] |= np.uint64(1 << min(place, BITS - 1))
        return translated

    def of(self, bits: int) -> tuple[str, ...]:
        """The names of the bits that are set."""
        return tuple(name for k, name in enumerate(self.names) if bits >> k & 1)
