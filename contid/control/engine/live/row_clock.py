"""When the rows of a live stream are played: as regularly as they were meant, once they have arrived.

* When a row was meant is learnt from when rows arrived (`producer_clock`).
* It is due `LAG` periods and the greatest lateness of the last seconds after that, when the rows that the
  curve needs beside it have arrived.
* Which row is played, the phase, follows what is due smoothly (`row_phase`). Another clock shows as a step: a
  period that is more than `FASTEST` times the one before lowers the rate of the phase at once, before rows
  that have not come are played, and rows far from what is played are played from there. The limits of the
  axes then hold by `contid.control.tick.jerk_guard`.
"""

from __future__ import annotations

import math
from typing import Final

from contid.control.engine.live.producer_clock import SPARSE_S, Lesson, ProducerClock
from contid.control.engine.live.row_phase import RowPhase
from contid.control.tick.config import MOTION_RULES

#: How many periods a row is played after it was meant: the curve needs two rows more.
LAG: Final = 2.0
#: What a row may be late besides, as a part of a tick.
MARGIN: Final = 0.1
#: Greatest error of the phase that its filter takes up [rows, s].
GREATEST_ERROR: Final = 4.0
GREATEST_S: Final = 0.05
#: Greatest rate of the phase with a new period, in rows per period.
FASTEST: Final = 3.0


class RowClock:
    """The clock that the rows of a stream are played by."""

    def __init__(self, tick_s: float, rules: int = MOTION_RULES) -> None:
        """``tick_s``: period of the ticks, at which rows arrive; ``rules``: of motion."""
        self._plays_longest = rules > 5
        self._tick_s = tick_s
        self._margin_s = MARGIN * tick_s
        self._producer = ProducerClock(tick_s, rules)
        self._phase = RowPhase(-LAG, tick_s)

    @property
    def newest(self) -> int:
        """Number of the newest row."""
        return self._producer.newest

    @property
    def period_s(self) -> float:
        """Learnt period, 0 while it is not known."""
        return self._producer.period_s

    @property
    def late_s(self) -> float:
        """Greatest lateness of the last seconds."""
        return self._producer.late_s

    @property
    def phase(self) -> float:
        """Which row is played, between two rows a fraction."""
        return self._phase.position

    @property
    def rate_per_s(self) -> float:
        """Rows played per second."""
        return self._phase.rate

    @property
    def stopping(self) -> bool:
        """True on the way of the phase to rest."""
        return self._phase.stopping

    @property
    def delay_s(self) -> float:
        """How long after it was meant a row is played; 0 without a clock."""
        return LAG * self.period_s + self.late_s + self._margin_s if self.period_s else 0.0

    def expected(self, now_s: float) -> float:
        """By how many rows a row that arrives now comes after the newest."""
        return (now_s - self._producer.meant_s) / self.period_s if self.period_s else 1.0

    def missing(self) -> float:
        """How many rows after the newest the curve needs now."""
        return math.floor(self.phase) + LAG - self.newest

    def arrived(self, now_s: float, rows: int = 1) -> None:
        """A row arrived.

        Args:
            now_s: when.
            rows: how many rows after the newest, at least 1; more after rows that were lost.
        """
        phase, late_s = self._phase, self.late_s
        lesson = self._producer.arrived(now_s, rows, int(phase.position) + 2, phase.stands)
        phase.go_on()
        if lesson is Lesson.PERIOD and self._plays_longest:  # it is played a tick on in this tick
            phase.start(self._due(now_s - self._tick_s, self.late_s), self._least_rate)
        elif lesson is Lesson.PERIOD:
            phase.start(self._due(now_s, late_s), self._least_rate)
        elif lesson is Lesson.ANEW and self.period_s:
            phase.slow_down(FASTEST / self.period_s)

    def play(self, now_s: float) -> float:
        """The phase at a tick."""
        phase, period_s = self._phase, self.period_s
        if not period_s or phase.stands:
            return phase.position
        error = self._due(now_s, self.late_s) - phase.position
        if abs(error) > GREATEST_ERROR + SPARSE_S / period_s:  # it follows another clock
            phase.start(phase.position + error, self._least_rate)
        else:
            # A row or more behind there are rows enough; else it goes on as slowly as those so far allow.
            rate = 1.0 / period_s if error > 1.0 else self._least_rate
            most = max(GREATEST_ERROR, GREATEST_S / period_s)
            phase.follow(min(max(error, -most), most), rate)
        return phase.position

    def stop(self, acceleration: float, jerk: float, forward: bool = False) -> bool:
        """One tick of the way of the phase to rest on the newest row; True when it is there.

        A clock without a period has no such way: its rows are targets of their own.

        Args:
            acceleration: greatest one of the phase [1/s^2].
            jerk: greatest one [1/s^3].
            forward: from rest where the phase ran backwards, after a change of the period, and within
                ``acceleration``.
        """
        return self._phase.stop(float(self.newest), 1.0 / self.period_s, acceleration, jerk, forward)

    @property
    def _least_rate(self) -> float:
        """Rows per second that come at least, by the rows so far; by rules before 6 those of the fit."""
        return 1.0 / (self._producer.longest_period_s if self._plays_longest else self.period_s)

    def _due(self, now_s: float, late_s: float) -> float:
        """Which row is to be played now, where rows come by so much too late."""
        since_s = now_s - self._producer.meant_s - late_s - self._margin_s
        return self.newest + since_s / self.period_s - LAG
