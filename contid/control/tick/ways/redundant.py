"""The command of a redundant robot whose tip stays on its target (`contid.control.tick.next_command`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.control.tick.limits import AxisLimits, brake_step
from contid.control.tick.tip_task import Task
from contid.kinematics.array import Array, pseudo_inverse, size_of

_STEPS: Final = 8
#: Redundant motion of an axis below this share of its greatest change of step is ignored.
_NONE: Final = 1e-6


@dataclass(frozen=True)
class Redundant:
    """The next command of a redundant robot within the bounds of this tick.

    Attributes:
        limits: of the axes.
        low, high: commands that they allow in this tick.
        task: what the target asks for, of a command [m].
        here: the task at the last command.
        J: its derivative there.
        inverse: pseudo-inverse of that.
        exact_m: error of the task at which a command is on target.
    """

    limits: Sequence[AxisLimits]
    low: Array
    high: Array
    task: Task
    here: Array
    J: Array
    inverse: Array
    exact_m: float

    def held(self, last: Array, answer: Array, answer_steps: Array, clipped: Array) -> Array | None:
        """A command with the tip where the answer has it, near a shared step; None if none was found."""
        goal = self.task(answer)
        J = self.J
        needed = self.inverse @ (goal - self.here)
        freely = self._braked(answer - last - needed, answer_steps - needed)
        shared = last + needed + self._share(freely, last + needed) * freely
        for begin in (shared, clipped):
            at = np.clip(begin, self.low, self.high)
            for _ in range(_STEPS):
                error = goal - self.task(at)
                if size_of(error) <= self.exact_m:
                    return at
                step = _bounded(J, error, self.low - at, self.high - at)
                at = np.clip(at + step, self.low, self.high)
        return None

    def _braked(self, gap: Array, pace: Array) -> Array:
        """The redundant step along with the answer that closes what all axes can brake from."""
        closing, share = gap - pace, 1.0
        for each, size in zip(self.limits, np.abs(closing).tolist(), strict=True):
            if size > _NONE * each.change:
                share = min(share, brake_step(size, each.change) / size)
        step: Array = pace + share * closing
        return step

    def _share(self, freely: Array, needed: Array) -> float:
        """Greatest share, at most 1, of the redundant step that the bounds allow for all axes.

        Negative where axes that move the other way have to brake first.
        """
        least, most = -math.inf, 1.0
        for each, change, at, low, high in zip(
            self.limits, freely.tolist(), needed.tolist(), self.low.tolist(), self.high.tolist(), strict=True
        ):
            if abs(change) > _NONE * each.change:
                ends = sorted(((low - at) / change, (high - at) / change))
                least, most = max(least, ends[0]), min(most, ends[1])
        return most if least <= most else 1.0


def _bounded(J: Array, error: Array, low: Array, high: Array) -> Array:
    """A short step with ``J d = error`` inside bounds: axes beyond their bound stop there, worst first."""
    d = np.zeros(J.shape[1])
    free = np.ones(len(d), dtype=bool)
    for _ in range(len(d)):
        d[free] = pseudo_inverse(J[:, free]) @ (error - J[:, ~free] @ d[~free])
        beyond = np.maximum(low - d, d - high)
        beyond[~free] = 0.0
        worst = int(np.argmax(beyond))
        if beyond[worst] <= 0.0:
            break
        d[worst] = min(max(d[worst], low[worst]), high[worst])
        free[worst] = False
        if not free.any():
            break
    return d
