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
        tip_force, tip_moment: at the tip [N, N·mm].
        joint_force, joint_moment: at the end of section i, before its link, by i [N, N·mm].
        weight: per reference length of section i [N/mm], by i.
        link_weight: per length of link i [N/mm], by i.
    """

    tip_force: Array = field(default_factory=_zeros)
    tip_moment: Array = field(default_factory=_zeros)
    joint_force: dict[int, Array] = field(default_factory=dict)
    joint_moment: dict[int, Array] = field(default_factory=dict)
    weight: dict[int, Array] = field(default_factory=dict)
    link_weight: dict[int, Array] = field(default_factory=dict)

    def scaled(self, factor: float) -> Loads:
        """The same loads times a factor, for continuation."""

        def times(table: dict[int, Array]) -> dict[int, Array]:
            return {i: factor * value for i, value in table.items()}

        return Loads(
            factor * self.tip_force,
            factor * self.tip_moment,
            times(self.joint_force),
            times(self.joint_moment),
            times(self.weight),
            times(self.link_weight),
        )

    def towards(self, other: Loads, part: float) -> Loads:
        """Loads between these (part 0) and others (part 1)."""

        def between(a: dict[int, Array], b: dict[int, Array]) -> dict[int, Array]:
            return {i: (1.0 - part) * a.get(i, _zeros()) + part * b.get(i, _zeros()) for i in {*a, *b}}

        return Loads(
            (1.0 - part) * self.tip_force + part * other.tip_force,
            (1.0 - part) * self.tip_moment + part * other.tip_moment,
            between(self.joint_force, other.joint_force),
            between(self.joint_moment, other.joint_moment),
            between(self.weight, other.weight),
            between(self.link_weight, other.link_weight),
        )

    def base_force(self, rod: Rod) -> Array:
        """N at the base [N], shape (3,): everything the rod carries."""
        total = self.tip_force.copy()
        for i, section in enumerate(rod.sections):
            total += self.joint_force.get(i, 0.0)
            total += section.length * self.weight.get(i, _zeros())
            total += section.link * self.link_weight.get(i, _zeros())
        return total

    @property
    def has_moments(self) -> bool:
        """True when a dead moment acts."""
        return any(np.any(moment) for moment in (self.tip_moment, *self.joint_moment.values()))

    @property
    def is_zero(self) -> bool:
        """True when nothing acts on the rod."""
        tables = (self.joint_force, self.joint_moment, self.weight, self.link_weight)
        vectors = (self.tip_force, self.tip_moment, *(v for table in tables for v in table.values()))
        return not any(np.any(vector) for vector in vectors)
