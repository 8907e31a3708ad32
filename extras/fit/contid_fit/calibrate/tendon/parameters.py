"""Named parameters of a fit with their priors: expected values and standard deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from contid.kinematics.array import Array


@dataclass(frozen=True, eq=False)
class Group:
    """Parameters of one kind.

    Attributes:
        name: such as ``radius_m``; the unit is its ending.
        labels: label of each value, such as ``s1.t2``.
        expected: value before the data.
        spread: standard deviation of that expectation; ridge penalty of the fit.
    """

    name: str
    labels: tuple[str, ...]
    expected: Array
    spread: Array


def group(
    name: str, labels: Sequence[str], expected: Array | Sequence[float] | float, spread: float
) -> Group:
    """A group with one spread."""
    values = np.broadcast_to(np.asarray(expected, dtype=np.float64), (len(labels),)).copy()
    return Group(name, tuple(labels), values, np.full(len(labels), spread))


@dataclass(frozen=True, eq=False)
class Parameters:
    """Groups, one after the other in the vector of the fit."""

    groups: tuple[Group, ...]

    @cached_property
    def slices(self) -> Mapping[str, slice]:
        """Place of each group in the vector."""
        ends = np.cumsum([0, *(len(each.labels) for each in self.groups)])
        return {
            each.name: slice(int(low), int(high))
            for each, low, high in zip(self.groups, ends[:-1], ends[1:], strict=True)
        }

    @cached_property
    def size(self) -> int:
        """Length of the vector."""
        return sum(len(each.labels) for each in self.groups)

    @cached_property
    def expected(self) -> Array:
        """The vector before the data."""
        return np.concatenate([each.expected for each in self.groups])

    @cached_property
    def spread(self) -> Array:
        """Standard deviation of the expectation."""
        return np.concatenate([each.spread for each in self.groups])

    def split(self, vector: Array) -> dict[str, Array]:
        """The values of each group."""
        return {name: vector[place] for name, place in self.slices.items()}

    def moved(self, vectors: Mapping[str, Array]) -> Parameters:
        """The same with other expected values."""
        return Parameters(
            tuple(
                Group(each.name, each.labels, np.array(vectors.get(each.name, each.expected)), each.spread)
                for each in self.groups
            )
        )
