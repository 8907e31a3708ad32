"""The convex set of lengths a chain of sections may take, with a name for every limit.

Three kinds of limits, all convex in the lengths l:

* minimum and maximum length of every tube or rack;
* the rack budget: the racks of a tri-rack arm pass through all segments, ``sum_i l_ij <= rack``;
* the bend radius: ``theta <= kappa_max L`` in every section, a cone, kept by its tangent planes
  ``d (u0 u + v0 v - kappa_max L) <= 0`` with ``(u0, v0)`` the direction of the bend (d makes it a length).

A point outside is brought inside by pulling it towards the home posture, which is straight and well inside.
``contid/kernels/arc/feasible.hpp`` keeps the same limits in the same order.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from contid.kinematics.arc.sections import ArcChain, Sections
from contid.kinematics.array import Array

# A limit binds when less than this is left of it [m]; far below any actuator, far above rounding.
BINDING_M: Final = 1e-9


class BoundedChain(ABC):
    """Convex limits of a chain of arcs: planes, then a cone per section.

    Attributes:
        sections: the chain.
        low, high: corners of a box around the limits [m], shape ``(N,)``.
        home: the posture that resolves redundancy, well inside [m].
    """

    sections: ArcChain
    low: Array
    high: Array
    home: Array

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the limits in the order of `excess`; several limits can share one."""

    @abstractmethod
    def excess(self, lengths: Array) -> Array:
        """By how much every limit is exceeded [m], negative inside, in the order of `names`."""

    @abstractmethod
    def pulled(self, lengths: Array | Sequence[float]) -> Array:
        """The first feasible point on the way from ``lengths`` (clipped to the box) to `home`."""

    def binding(self, lengths: Array) -> int:
        """Bit mask of the limits that bind, in the order of `names`."""
        return sum(1 << int(k) for k in np.flatnonzero(self.excess(lengths) > -BINDING_M))

    def named(self, binding: int) -> tuple[str, ...]:
        """Names of the limits whose bits are set, each once."""
        if not binding:
            return ()
        return tuple(dict.fromkeys(name for k, name in enumerate(self.names) if binding >> k & 1))


@dataclass(frozen=True, eq=False)
class Feasible(BoundedChain):
    """Limits of one chain.

    Attributes:
        sections: the geometry.
        lower, upper: interval of the tubes of each section [m].
        rack_m: maximum sum of one rack's lengths over the sections [m], may be inf.
        curvature_max: maximum curvature of the backbone in every section [1/m], may be inf.
        home: the posture that resolves redundancy: straight, in the middle of the range.
    """

    sections: Sections
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    rack_m: float = math.inf
    curvature_max: float = math.inf
    low: Array = field(init=False)
    high: Array = field(init=False)
    home: Array = field(init=False)

    def __post_init__(self) -> None:
        low, high = np.repeat(self.lower, 3), np.repeat(self.upper, 3)
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)
        part = min(0.5, 0.5 * (self.rack_m - sum(self.lower)) / (sum(self.upper) - sum(self.lower)))
        if not part > 0.0:
            raise ValueError("the racks are shorter than the retracted arm")
        object.__setattr__(self, "home", low + part * (high - low))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the limits in the order of the bits of `binding`."""
        tubes = [f"s{s + 1}.l{j + 1}" for s in range(self.sections.count) for j in range(3)]
        return (
            *(f"{name}.min" for name in tubes),
            *(f"{name}.max" for name in tubes),
            *(f"rack{j + 1}.length" for j in range(3)),
            *(f"s{s + 1}.bend_radius" for s in range(self.sections.count)),
        )

    def excess(self, lengths: Array) -> Array:
        """By how much every limit is exceeded [m], negative inside, in the order of `names`."""
        arcs = self.sections.arcs(lengths)
        bend = np.full(self.sections.count, -math.inf)
        if self.curvature_max < math.inf:
            bend = np.hypot(arcs[:, 0], arcs[:, 1]) - self.curvature_max * arcs[:, 2]
        return np.concatenate(
            (
                self.low - lengths,
                lengths - self.high,
                lengths.reshape(-1, 3).sum(axis=0) - self.rack_m,
                np.array(self.sections.radius_m) * bend,
            )
        )

    def pulled(self, lengths: Array | Sequence[float]) -> Array:
        """The first feasible point on the way from ``lengths`` (clipped to their intervals) to `home`."""
        clipped = np.clip(np.asarray(lengths, dtype=np.float64), self.low, self.high)
        share = feasible_share(self.excess(clipped), self.excess(self.home))
        if share == 1.0:
            return clipped
        pulled: Array = np.clip(self.home + share * (clipped - self.home), self.low, self.high)
        return pulled


def feasible_share(outside: Array, inside: Array) -> float:
    """Part of the way from a feasible point to another one that keeps every limit.

    Args:
        outside: excess of each limit at the other point.
        inside: values at the feasible point, none positive.
    """
    share = 1.0
    for excess_outside, excess_inside in zip(outside, inside, strict=True):
        if excess_outside > 0.0:  # excess is convex, so the chord between the two ends lies above it
            share = min(share, excess_inside / (excess_inside - excess_outside))
    return share
