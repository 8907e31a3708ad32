"""Contacts of axes that are servos: a current above the usual one, by a cumulative sum.

    c' = max(0, c + (|i| - usual - contact/2) dt),      a contact where c > contact/2 * `WITHIN_S`

So a current of usual + contact is found within `WITHIN_S`, a larger one earlier, one below usual + contact/2
never. A pure function of its inputs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from contid.hal import Sample

#: Time in which a current of usual + contact is found [s].
WITHIN_S: Final = 0.04
#: Time constant of mean and spread of the usual current [s].
_MEMORY_S: Final = 5.0
#: Least standard deviation of a current [A]: one unit of the registers.
_LEAST_A: Final = 1e-3


@dataclass(frozen=True, slots=True)
class AxisContactFound:
    """Axes that push against something.

    Attributes:
        axes: their indices.
        excess_a: largest current above the usual one [A].
        confidence: 1 minus the expected number of such currents in an hour without a contact, by the spread
            of the usual current.
    """

    axes: tuple[int, ...]
    excess_a: float
    confidence: float


class CurrentContact:
    """The currents of one robot.

    Args:
        axes: their number.
        usual_a: greatest current without a contact [A].
        contact_a: current above it that is a contact [A].
        period_s: of the tick.
    """

    def __init__(self, axes: int, usual_a: float, contact_a: float, period_s: float) -> None:
        self._usual_a = usual_a
        self._half_a = 0.5 * contact_a
        self._period_s = period_s
        self._sums = [0.0] * axes
        self._in_contact = [False] * axes
        self._means = [0.0] * axes
        self._squares = [_LEAST_A**2] * axes

    def tick(self, samples: Sequence[Sample]) -> AxisContactFound | None:
        """The axes that met something in this tick; one is found again once its current was usual."""
        found: dict[int, float] = {}
        for axis, sample in enumerate(samples):
            if not sample.valid or sample.effort is None:
                continue
            current_a = abs(sample.effort)
            above_a = current_a - self._usual_a - self._half_a
            self._sums[axis] = max(0.0, self._sums[axis] + above_a * self._period_s)
            if self._sums[axis] == 0.0:
                self._in_contact[axis] = False
                self._learn(axis, current_a)
            elif self._sums[axis] > self._half_a * WITHIN_S and not self._in_contact[axis]:
                self._in_contact[axis] = True
                found[axis] = current_a
            # A contact that ends is over after `WITHIN_S` too.
            self._sums[axis] = min(self._sums[axis], 2.0 * self._half_a * WITHIN_S)
        if not found:
            return None
        axis = max(found, key=lambda each: found[each])
        confidence = self._confidence(axis, found[axis])
        return AxisContactFound(tuple(found), found[axis] - self._usual_a, confidence)

    def _learn(self, axis: int, current_a: float) -> None:
        share = self._period_s / _MEMORY_S
        off_a = current_a - self._means[axis]
        self._means[axis] += share * off_a
        self._squares[axis] += share * (off_a * off_a - self._squares[axis])

    def _confidence(self, axis: int, current_a: float) -> float:
        sigma_a = math.sqrt(max(self._squares[axis], _LEAST_A**2))
        sigmas = max(0.0, current_a - self._means[axis]) / sigma_a
        return max(0.0, 1.0 - 3600.0 / self._period_s * math.erfc(sigmas / math.sqrt(2.0)))
