"""The convex set of lengths a chain of sections may take, with a name for every limit.

Three kinds of limits, all convex in the lengths l:

* minimum and maximum length of every tube or rack;
* the rack budget: the racks of a tri-rack arm pass through all segments, ``sum_i l_ij <= rack``;
* the bend radius: ``theta <= kappa_max L`` in every section, a cone, kept by its tangent planes
  ``d (u0 u + v0 v - kappa_max L) <= 0`` with ``(u0, v0)`` the direction of the bend (d makes it a length).

A point outside is brought inside by pulling it towards the home posture, which is straight and well inside.
Specification of ``contid/kernels/arc/feasible.hpp``.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from contid.kinematics.arc.sections import ArcChain, Sections
from contid.kinematics.array import Array

# A limit binds when less than this is left of it [m]; far below any actuator, far above rounding.
BINDING_M: Final = 1e-9


class BoundedChain(ABC):
    """Convex limits of a chain of arcs, as the solver uses them: planes, then a cone per section.

    Attributes:
        sections: the chain.
        low, high: corners of a box around the limits [m], shape ``(N,)``.
        home: the posture that resolves redundancy, well inside [m].
        metric: of the distance from home, ``(N, N)``.
    """

    sections: ArcChain
    low: Array
    high: Array
    home: Array
    metric: Array

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the limits in the order of `excess`; several limits can share one."""

    @property
    @abstractmethod
    def flat(self) -> int:
        """Number of limits that are planes; the cones follow."""

    @property
    @abstractmethod
    def longest_m(self) -> float:
        """No tip is farther from the base than this [m]."""

    @abstractmethod
    def excess(self, lengths: Array) -> Array:
        """By how much every limit is exceeded [m], negative inside, in the order of `names`."""

    @abstractmethod
    def normal(self, lengths: Array, number: int) -> Array:
        """Gradient of one limit's excess, shape ``(N,)``."""

    @abstractmethod
    def cone_curvature(self, lengths: Array, s: int) -> Array:
        """Second derivative of the excess of a section's cone, ``(N, N)``; 0 for a straight section."""

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

    def worst(self, lengths: Array, held: Collection[int]) -> tuple[float, Array, int]:
        """The limit exceeded most, ``held`` flat ones left out: excess [m], normal ``(N,)`` and number."""
        excess = self.excess(lengths)
        excess[[number for number in held if number < self.flat]] = -math.inf
        number = int(np.argmax(excess))
        return float(excess[number]), self.normal(lengths, number), number


@dataclass(frozen=True, eq=False)
class Feasible(BoundedChain):
    """Limits of one chain.

    Attributes:
        sections: the geometry.
        lower, upper: interval of the tubes of each section [m].
        rack_m: maximum sum of one rack's lengths over the sections [m], may be inf.
        curvature_max: maximum curvature of the backbone in every section [1/m], may be inf.
        home: the posture that resolves redundancy: straight, in the middle of the range.
        metric: of the distance from home, ``(3 n, 3 n)``: ``3 (L - L0)^2 + max(1.5 d^2, L0^2/2) theta^2`` per
            section. The Euclidean distance of the lengths has 1.5 d^2 there, with which a thin arm bends
            instead of shortening: straight is nearest only while the weight of theta^2 exceeds (L0 - L) L.
    """

    sections: Sections
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    rack_m: float = math.inf
    curvature_max: float = math.inf
    low: Array = field(init=False)
    high: Array = field(init=False)
    home: Array = field(init=False)
    metric: Array = field(init=False)

    def __post_init__(self) -> None:
        low, high = np.repeat(self.lower, 3), np.repeat(self.upper, 3)
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)
        part = min(0.5, 0.5 * (self.rack_m - sum(self.lower)) / (sum(self.upper) - sum(self.lower)))
        if not part > 0.0:
            raise ValueError("the racks are shorter than the retracted arm")
        object.__setattr__(self, "home", low + part * (high - low))
        object.__setattr__(self, "metric", self._home_metric())

    def _home_metric(self) -> Array:
        metric = np.zeros((len(self.low), len(self.low)))
        for i, d in enumerate(self.sections.radius_m):
            bend = max(1.5 * d * d, 0.5 * self.home[3 * i] ** 2)
            to_arc, block = self.sections.to_arc[i], slice(3 * i, 3 * i + 3)
            metric[block, block] = to_arc.T @ np.diag((bend, bend, 3.0)) @ to_arc
        return metric

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

    @property
    def flat(self) -> int:
        """Number of limits that are planes; the cones follow."""
        return 2 * len(self.low) + 3

    @property
    def longest_m(self) -> float:
        """No tip is farther from the base than this [m]: the straight arm at its longest."""
        return min(sum(self.upper), self.rack_m) + sum(self.sections.rigid_m)

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

    def normal(self, lengths: Array, number: int) -> Array:
        """Gradient of one limit's excess at these lengths, shape ``(3 n,)``."""
        size = len(lengths)
        normal = np.zeros(size)
        if number < 2 * size:
            normal[number % size] = 1.0 if number >= size else -1.0
        elif number < 2 * size + 3:
            normal[number - 2 * size :: 3] = 1.0
        else:
            s = number - 2 * size - 3
            u, v, _ = self.sections.arcs(lengths)[s]
            theta = math.hypot(u, v) or 1.0
            along = np.array([u / theta, v / theta, -self.curvature_max])
            normal[3 * s : 3 * s + 3] = self.sections.radius_m[s] * (along @ self.sections.to_arc[s])
        return normal

    def cone_curvature(self, lengths: Array, s: int) -> Array:
        """Second derivative of the excess of a section's cone, ``(3 n, 3 n)``; 0 for a straight section."""
        size = len(lengths)
        curvature = np.zeros((size, size))
        u, v, _ = self.sections.arcs(lengths)[s]
        theta = math.hypot(u, v)
        if theta >= 1e-9:
            to_arc = self.sections.to_arc[s]
            across = (u * to_arc[1] - v * to_arc[0]) / theta  # part of d(u, v)/dl across the bend
            block = slice(3 * s, 3 * s + 3)
            curvature[block, block] = self.sections.radius_m[s] / theta * np.outer(across, across)
        return curvature

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
        inside: at the feasible point, none positive.
    """
    share = 1.0
    for there, here in zip(outside, inside, strict=True):
        if there > 0.0:  # excess is convex, so the chord between the two ends lies above it
            share = min(share, here / (here - there))
    return share


class TangentLimits:
    """The same limits with every cone replaced by its tangent plane at one point: all of them are flat."""

    def __init__(self, feasible: BoundedChain, at: Array) -> None:
        self._feasible = feasible
        self._flat = self.flat = feasible.flat
        cones = range(self._flat, self._flat + feasible.sections.count)
        self._normals = np.array([feasible.normal(at, number) for number in cones])
        self._offsets = feasible.excess(at)[self._flat :] - self._normals @ at

    def worst(self, lengths: Array, held: Collection[int]) -> tuple[float, Array, int]:
        """As `Feasible.worst`; tangent planes that are held are left out too."""
        excess = self._feasible.excess(lengths)
        excess[self._flat :] = self._offsets + self._normals @ lengths
        for number in held:
            excess[number] = -math.inf
        number = int(np.argmax(excess))
        return float(excess[number]), self.normal(lengths, number), number

    def normal(self, lengths: Array, number: int) -> Array:
        """Gradient of one limit's excess, shape ``(3 n,)``."""
        if number >= self._flat:
            plane: Array = self._normals[number - self._flat]
            return plane
        return self._feasible.normal(lengths, number)
