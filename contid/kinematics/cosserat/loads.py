"""Loads on a rod [N, N·mm]."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.section import Rod


def _zeros() -> Array:
    return np.zeros(3)


@dataclass(frozen=True)
class Loads:
    """Dead loads in the base frame.

    Attributes:
        tip_force, tip_moment: force and moment at the tip [N, N·mm].
        joint_force, joint_moment: force and moment at the end of section i, before its link, by i [N, N·mm].
        weight: weight per reference length of section i [N/mm], by i.
        link_weight: weight per length of link i [N/mm], by i.
    """

    tip_force: Array = field(default_factory=_zeros)
    tip_moment: Array = field(default_factory=_zeros)
    joint_force: dict[int, Array] = field(default_factory=dict)
    joint_moment: dict[int, Array] = field(default_factory=dict)
    weight: dict[int, Array] = field(default_factory=dict)
    link_weight: dict[int, Array] = field(default_factory=dict)

    def base_force(self, rod: Rod) -> Array:
        """N at the base [N], shape (3,), of the weights and the force on the tip."""
        total = self.tip_force.copy()
        for i, section in enumerate(rod.sections):
            total += section.length * self.weight.get(i, _zeros())
            total += section.link * self.link_weight.get(i, _zeros())
        return total

    @property
    def has_moments(self) -> bool:
        """True when a dead moment acts; it has no energy, so the kernel does not count unstable modes."""
        return any(np.any(moment) for moment in (self.tip_moment, *self.joint_moment.values()))
