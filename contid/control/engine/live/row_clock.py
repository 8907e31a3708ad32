"""When the rows of a live stream are played: as regularly as they were meant, once they have arrived.

* When a row was meant is learnt from when rows arrived (`producer_clock`).
* It is due `LAG` periods and the greatest lateness of the last seconds after that, when the rows that the
  curve needs beside it have arrived.
* Which row is played, the phase, follows what is due with a third-order filter, so that what a clock learns
  shows as no step of its velocity or acceleration. Another clock shows as a step: a period that is more than
  `FASTEST` times the one before lowers the rate of the phase at once, before rows that have not come are
  played, and rows far from what is played are played from there. The limits of the axes then hold by
  `contid.control.tick.jerk_guard`.
* The phase makes up for ticks that were skipped within `MADE_UP_S` or so: rows came meanwhile.
* Where rows stop, the phase comes to rest on the newest one by a jerk-limited motion.
"""

from __future__ import annotations

import math
from typing import Final

from contid.control.engine.live.producer_clock import SPARSE_S, Lesson, ProducerClock
from contid.control.tick.config import MOTION_RULES
from contid.trajectory.pursuit import AxisRates, MovingAxes, braked, pursued

#: How many periods a row is played after it was meant: the curve needs two rows more.
LAG: Final = 2.0
#: What a row may be late besides, as a part of a tick.
MARGIN: Final = 0.1
#: Rate of the filter of the phase [1/s], and the greatest error that it takes up [rows, s].
FOLLOW_PER_S: Final = 8.0
GREATEST_ERROR: Final = 4.0
GREATEST_S: Final = 0.05
#: Greatest rate of the phase with a new period, in rows per period.
FASTEST: Final = 3.0
#: Time in which the phase makes up for most of the ticks that were skipped, and the most that it takes up.
MADE_UP_S: Final = 0.25
MOST_SKIPPED_S: Final = SPARSE_S
#: A phase is on a row, and at rest, within this part of it.
_THERE: Final = 1e-9


class RowClock(ProducerClock):
    """The clock of a producer, and the phase that its rows are played by.

    Attributes:
        phase: which row is played, between two rows a fraction.
        rate_per_s: rows played per second.
        stop: the motion of the phase to rest; None while rows are played, and once it stands.
        stands: the phase came to rest on a row.
        stop_rates: greatest acceleration and jerk of the stop [1/s^2, 1/s^3].
        resumes: rows came during the stop.
    """

    def __init__(self, tick_s: float, rules: int = MOTION_RULES) -> None:
        """``tick_s``: period of the ticks, at which rows arrive; ``rules``: of motion."""
        super().__init__(tick_s, rules)
        self.phase, self.rate_per_s, self._acceleration = -LAG, 0.0, 0.0
        self.stop: MovingAxes | None = None
        self.stands = self.resumes = False
        self.stop_rates = (0.0, 0.0)
        self._farthest_s = 2.0 * SPARSE_S if self._keeps_period else SPARSE_S
        self._plays_longest = rules > 5
        self._margin_s = MARGIN * tick_s
        self._skipped_s = self._behind_s = 0.0  # all ticks that were skipped; of these not made up for
        #: Rows per second that come at least, by the rows so far; by rules before 6 those of the fit.
        self._least_per_s = 0.0

    @property
    def delay_s(self) -> float:
        """How long after it was meant a row is played; 0 without a clock."""
        return LAG * self.period_s + self.late_s + self._margin_s if self.period_s else 0.0

    def expected(self, now_s: float) -> float:
        """By how many rows a row that arrives now comes after the newest."""
        return (now_s - self.meant_s) / self.period_s if self.period_s else 1.0

    def came_s(self, now_s: float, skipped_s: float) -> float:
        """When a row came that was read now: as expected, where that is within the ticks that were skipped.

        ``skipped_s``: as of `skip`, which comes after the rows of a tick.
        """
        waited_s = skipped_s - self._skipped_s
        if not (self.period_s and waited_s > 0.0 and self._keeps_period):
            return now_s
        return min(max(self.meant_s + self.period_s, now_s - waited_s), now_s)

    def skip(self, skipped_s: float) -> None:
        """A tick begins; ``skipped_s``: the time of all ticks that were skipped so far."""
        behind_s = self._behind_s * (1.0 - self._tick_s / MADE_UP_S) + skipped_s - self._skipped_s
        self._behind_s, self._skipped_s = min(behind_s, MOST_SKIPPED_S), skipped_s

    def missing(self) -> float:
        """How many rows after the newest the curve needs now."""
        return math.floor(self.phase) + LAG - self.newest

    def arrived(self, now_s: float, rows: int = 1) -> None:
        """A row arrived.

        Args:
            now_s: when.
            rows: how many rows after the newest, at least 1; more after rows that were lost.
        """
        late_s = self.late_s
        lesson = self.learn(now_s, rows, int(self.phase) + 2, self.stands)
        self.resumes = self.stop is not None and self._keeps_period and self.period_s > 0.0
        self.stop = self.stop if self.resumes else None
        self.stands = False
        if lesson is Lesson.ANEW and self._keeps_period:
            self._behind_s = 0.0  # its rows did not come by a clock that went on
        if not self.period_s:
            return
        self._least_per_s = 1.0 / (self.longest_period_s if self._plays_longest else self.period_s)
        if lesson is Lesson.PERIOD and self._plays_longest:  # it is played a tick on in this tick
            self._start(self._due(now_s - self._tick_s, self.late_s), self._least_per_s)
        elif lesson is Lesson.PERIOD:
            self._start(self._due(now_s, late_s), self._least_per_s)
        elif lesson is Lesson.ANEW and self.rate_per_s > FASTEST / self.period_s:
            self.rate_per_s, self._acceleration = FASTEST / self.period_s, 0.0
            self.stop = None

    def play(self, now_s: float) -> float:
        """The phase at a tick."""
        period_s = self.period_s
        if not period_s or self.stands:
            return self.phase
        if self.resumes and self.stop is not None:
            return self._resume(self.stop)
        error = self._due(now_s, self.late_s) - self.phase
        if abs(error) > GREATEST_ERROR + self._farthest_s / period_s:  # it follows another clock
            self._start(self.phase + error, self._least_per_s)
            return self.phase
        # A row or more behind there are rows enough; else it goes on as slowly as those so far allow.
        rate = 1.0 / period_s if error > 1.0 else self._least_per_s
        rate *= 1.0 + self._behind_s / MADE_UP_S
        most = max(GREATEST_ERROR, GREATEST_S / period_s)
        error, w = min(max(error, -most), most), FOLLOW_PER_S
        jerk = w * (w * (w * error + 3.0 * (rate - self.rate_per_s)) - 3.0 * self._acceleration)
        self._acceleration += jerk * self._tick_s
        self.rate_per_s += self._acceleration * self._tick_s
        self.phase += self.rate_per_s * self._tick_s
        return self.phase

    def come_to_rest(self, forward: bool = False) -> bool:
        """One tick of the motion of the phase to rest on the newest row; True when it is there.

        A clock without a period has no such motion: its rows are targets of their own.

        Args:
            forward: from rest where the phase ran backwards, after a change of the period, and within the
                acceleration of the stop.
        """
        self.resumes = False
        acceleration, jerk = self.stop_rates
        row, rate = float(self.newest), 1.0 / self.period_s
        now = self.stop or self._begin_of_stop(acceleration, forward)
        top = 2.0 * max(abs(now.velocity[0]), rate)
        after = pursued(now, (row,), (0.0,), AxisRates((top,), (acceleration,), (jerk,)), self._tick_s)
        if after is None or (abs(after.position[0] - row) < _THERE and abs(after.velocity[0]) < _THERE * top):
            self._start(row, rate)
            self.stop, self.stands = None, True
            return True
        (self.phase,), (self.rate_per_s,), (self._acceleration,) = (
            after.position,
            after.velocity,
            after.acceleration,
        )
        self.stop = after
        return False

    def _begin_of_stop(self, most: float, forward: bool) -> MovingAxes:
        """Where it begins; ``forward``: not backwards, and within the acceleration ``most``."""
        rate, acceleration = self.rate_per_s + 0.5 * self._acceleration * self._tick_s, self._acceleration
        if forward:
            acceleration = min(max(acceleration, -most), most) if rate > 0.0 else 0.0
            rate = max(rate, 0.0)
        return MovingAxes((self.phase,), (rate,), (acceleration,))

    def _resume(self, now: MovingAxes) -> float:
        """One tick of the motion from a stop that rows ended to their rate, within the limits of the stop."""
        rate = (1.0 + self._behind_s / MADE_UP_S) / self.period_s
        lost = abs(now.velocity[0] - rate)
        state = MovingAxes(now.position, (now.velocity[0] - rate,), now.acceleration)
        most = AxisRates((2.0 * max(lost, rate),), *[(each,) for each in self.stop_rates])
        after = braked(state, most, self._tick_s, together=False)
        if after is None or abs(after.velocity[0]) < _THERE * rate:
            self.stop = None
            self._start(self.phase + rate * self._tick_s, rate)
            return self.phase
        self.phase = after.position[0] + rate * self._tick_s
        self.rate_per_s, (self._acceleration,) = after.velocity[0] + rate, after.acceleration
        self.stop = MovingAxes((self.phase,), (self.rate_per_s,), after.acceleration)
        return self.phase

    def _start(self, phase: float, rate_per_s: float) -> None:
        """Go on from a phase at a rate, at once."""
        self.phase, self.rate_per_s, self._acceleration = phase, rate_per_s, 0.0

    def _due(self, now_s: float, late_s: float) -> float:
        """Which row is to be played now, where rows come by so much too late."""
        since_s = now_s - self._behind_s - self.meant_s - late_s - self._margin_s
        return self.newest + since_s / self.period_s - LAG
