"""Jogging without I/O: pressed directions to set-points, with a dead-man time.

A direction that is pressed moves the reference at the chosen speed for the hold time, and no longer:
without another press the reference stands still. So one press is one step of speed times hold time, a key
that repeats moves steadily, and a late or hanging program moves at most one step further.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

#: Factor of one change of the speed.
SPEED_FACTOR: Final = 1.5
#: While no reference was taken yet, it goes so far from the start, as time at the greatest speed [s].
LEAD_S: Final = 0.1


class Jogger:
    """The reference of some columns.

    Args:
        start: reference at the beginning, in the units of the columns.
        minimum, maximum: limits of the reference; None where only the robot decides (tips).
        speed: speed of the reference [unit/s].
        max_speed: greatest speed that can be chosen.
        hold_s: how long one press moves.
        scales: speed of each column as a multiple of ``speed``, for columns in other units; 1 by default.

    Attributes:
        reference: the present set-point.
        speed: chosen speed.
    """

    def __init__(
        self,
        start: Sequence[float],
        minimum: Sequence[float] | None,
        maximum: Sequence[float] | None,
        *,
        speed: float,
        max_speed: float,
        hold_s: float,
        scales: Sequence[float] | None = None,
    ) -> None:
        self.reference = [float(value) for value in start]
        self._accepted = list(self.reference)
        self._taken = False
        self._scales = list(scales or (1.0 for _ in self.reference))
        self._leads = [LEAD_S * max_speed * scale for scale in self._scales]
        self._minimum, self._maximum = minimum, maximum
        self.speed = min(speed, max_speed)
        self._max_speed = max_speed
        self._hold_s = hold_s
        self._rates = [0.0] * len(self.reference)
        self._until_s = [float("-inf")] * len(self.reference)
        self._now_s: float | None = None

    def press(self, index: int, share: float, now_s: float) -> None:
        """Move a column from now on with a share of the speed, -1 to 1; an opposite press turns at once."""
        self.advance(now_s)
        self._rates[index] = min(max(share, -1.0), 1.0)
        self._until_s[index] = now_s + self._hold_s

    def release(self) -> None:
        """Stand still from now on."""
        self._until_s = [float("-inf")] * len(self.reference)

    def moving(self, now_s: float) -> bool:
        """A direction is pressed."""
        return any(until_s > now_s and rate for until_s, rate in zip(self._until_s, self._rates, strict=True))

    def advance(self, now_s: float) -> list[float]:
        """The reference at a time."""
        before_s = now_s if self._now_s is None else self._now_s
        self._now_s = now_s
        for index, rate in enumerate(self._rates):
            moved_s = min(now_s, self._until_s[index]) - before_s
            if moved_s > 0.0:
                self.reference[index] += rate * self.speed * self._scales[index] * moved_s
                if self._minimum is not None and self._maximum is not None:
                    low, high = self._minimum[index], self._maximum[index]
                    self.reference[index] = min(max(self.reference[index], low), high)
        return self.reference

    def accept(self) -> None:
        """The daemon took the reference."""
        self._accepted = list(self.reference)
        self._taken = True

    def take(self, values: Sequence[float]) -> None:
        """The daemon took other values in place of the reference, from which it goes on."""
        self.reference = list(values)
        self.accept()

    def refuse(self) -> None:
        """The daemon refused the reference: back to the last one it took.

        Braking can end beyond a limit that several axes share. From there the reference has to come back
        before the first one is taken, so until then it stays, near the start.
        """
        if not self._taken:
            each = zip(self.reference, self._accepted, self._leads, strict=True)
            self.reference = [min(max(value, at - lead), at + lead) for value, at, lead in each]
            return
        self.reference = list(self._accepted)
        self.release()

    def faster(self) -> None:
        """A higher speed, up to the greatest."""
        self.speed = min(self.speed * SPEED_FACTOR, self._max_speed)

    def slower(self) -> None:
        """A lower speed."""
        self.speed = max(self.speed / SPEED_FACTOR, 1e-3 * self._max_speed)
