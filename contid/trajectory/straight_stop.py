"""The shortest stop that keeps its direction: every axis sheds the same share of its speed in every tick.

The jerk-limited stop (`contid.trajectory.standstill`) is gentler and goes further: how far depends on the
acceleration at its beginning. This one depends on the last step alone, and no motion within the limit of
acceleration comes to rest earlier on the same line. So a motion that ends in front of something can always be
stopped before it, and a stop that was begun can be begun again.

After a step s in one tick the steps of the next ticks are s (1 - k/n), k = 1 ... n, with the smallest n for
which no axis changes its step by more than its limit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from contid.targets import Actuation
from contid.trajectory.standstill import MotionState

#: Rounding of a number of ticks.
_ROUNDING = 1e-9


class StraightStop:
    """A stop on a straight line, from a position and the step that led to it.

    Args:
        position: of the axes [m or Pa].
        step: position minus that of the tick before [m or Pa].
        changes: greatest change of a step of each axis from tick to tick, above 0 [m or Pa].
        ends: minimum and maximum position of each axis; an axis that begins inside stays inside, and rests
            where it meets an end.
        period_s: of the tick.

    Attributes:
        duration_s: time until every axis rests.
        distances: length of the way of each axis, before it is limited to ``ends`` [m or Pa].

    Raises:
        ValueError: a change that is not above 0.
    """

    def __init__(
        self,
        position: Actuation,
        step: Actuation,
        changes: Sequence[float],
        ends: Sequence[tuple[float, float]],
        period_s: float,
    ) -> None:
        if not all(change > 0.0 for change in changes):
            raise ValueError(f"changes: above 0 is expected, got {list(changes)}")
        self._position = position
        self._step = step
        self._ends = ends
        self._period_s = period_s
        ticks = max([abs(own) / change for own, change in zip(step, changes, strict=True)], default=0.0)
        self._ticks = max(1, math.ceil(ticks - _ROUNDING))
        self.duration_s = (self._ticks - 1) * period_s
        self.distances: Actuation = tuple([0.5 * abs(each) * (self._ticks - 1) for each in step])

    def at(self, time_s: float) -> MotionState:
        """The state a time after the start; the start before it, rest at the end after."""
        tick = min(max(time_s, 0.0), self.duration_s) / self._period_s
        steps = tick - 0.5 * tick * (tick + 1.0) / self._ticks
        free = [begin + step * steps for begin, step in zip(self._position, self._step, strict=True)]
        reached = [
            min(max(at, min(low, begin)), max(high, begin))
            for at, begin, (low, high) in zip(free, self._position, self._ends, strict=True)
        ]
        moving = tick * self._period_s < self.duration_s
        velocity_per_step = (1.0 - tick / self._ticks) / self._period_s if moving else 0.0
        velocity = [
            step * velocity_per_step if at == there else 0.0
            for step, at, there in zip(self._step, free, reached, strict=True)
        ]
        return MotionState(tuple(reached), tuple(velocity))
