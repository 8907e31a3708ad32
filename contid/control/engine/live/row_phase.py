"""The phase of a stream: which row is played, between two rows a fraction.

It follows the row that is due with a third-order filter, so that what a clock learns shows as no step of its
velocity or acceleration, and comes to rest on a row by a jerk-limited motion.
"""

from __future__ import annotations

from typing import Final

from contid.trajectory.pursuit import AxisRates, MovingAxes, pursued

#: Rate of the filter [1/s].
FOLLOW_PER_S: Final = 8.0
#: A phase is on a row, and at rest, within this part of it.
_THERE: Final = 1e-9


class RowPhase:
    """Position, rate and acceleration among rows, tick by tick.

    Attributes:
        position: which row is played.
        rate: rows per second.
        stands: it came to rest on a row.
    """

    def __init__(self, position: float, tick_s: float) -> None:
        self.position = position
        self.rate = self._acceleration = 0.0
        self.stands = False
        self._tick_s = tick_s
        self._stop: MovingAxes | None = None

    @property
    def stopping(self) -> bool:
        """True on the way to rest."""
        return self._stop is not None

    def start(self, position: float, rate: float) -> None:
        """Go on from a position at a rate, at once."""
        self.position, self.rate, self._acceleration = position, rate, 0.0

    def go_on(self) -> None:
        """Leave the way to rest, or the rest, where it is."""
        self._stop, self.stands = None, False

    def slow_down(self, most: float) -> None:
        """Lower the rate to ``most``, at once."""
        if self.rate > most:
            self.rate, self._acceleration = most, 0.0

    def follow(self, error: float, rate: float) -> None:
        """One tick of the filter: ``error`` rows behind what is due, which advances at a rate."""
        w = FOLLOW_PER_S
        jerk = w * (w * (w * error + 3.0 * (rate - self.rate)) - 3.0 * self._acceleration)
        self._acceleration += jerk * self._tick_s
        self.rate += self._acceleration * self._tick_s
        self.position += self.rate * self._tick_s

    def stop(self, row: float, rate: float, acceleration: float, jerk: float, forward: bool) -> bool:
        """One tick of the way to rest on a row; True when it is there. Arguments as of `RowClock.stop`.

        ``rate`` is that of rows [1/s], with which it goes on from there.
        """
        now = self._stop or self._state(acceleration, forward)
        top = 2.0 * max(abs(now.velocity[0]), rate)
        after = pursued(now, (row,), (0.0,), AxisRates((top,), (acceleration,), (jerk,)), self._tick_s)
        if after is None or (abs(after.position[0] - row) < _THERE and abs(after.velocity[0]) < _THERE * top):
            self.start(row, rate)
            self._stop, self.stands = None, True
            return True
        self.position, self.rate, self._acceleration = (
            after.position[0],
            after.velocity[0],
            after.acceleration[0],
        )
        self._stop = after
        return False

    def _state(self, most: float, forward: bool) -> MovingAxes:
        """Where the way to rest begins; ``forward``: not backwards, and within the acceleration ``most``."""
        rate, acceleration = self.rate + 0.5 * self._acceleration * self._tick_s, self._acceleration
        if forward:
            acceleration = min(max(acceleration, -most), most) if rate > 0.0 else 0.0
            rate = max(rate, 0.0)
        return MovingAxes((self.position,), (rate,), (acceleration,))
