"""The clock of a live stream: when each row was meant, learnt from when rows arrived, and where to play.

Row n of a producer with a period T is meant at ``t0 + n T`` and arrives later, by a part that varies. Both
numbers are learnt by least squares over all rows, from `WINDOW_S` on with fading memory (an alpha-beta filter
whose gains are those of a growing least-squares fit: E. Brookner, "Tracking and Kalman Filtering Made Easy",
1998, section 1.2.10). Rows are played `LAG` periods and the greatest lateness of the last seconds after that,
so the rows that a curve needs have arrived. The phase, which counts rows, follows with a third-order filter:
what the clock learns about a producer shows as no step of its velocity or acceleration. Another clock does:
a period that is more than `FASTEST` times the one before lowers the rate of the phase at once, before rows
that have not come are played, and rows far from what is played are played from there. The limits of the axes
then hold by `contid.control.tick.jerk_guard`.
"""

from __future__ import annotations

import math
from typing import Final

from contid.control.tick.config import MOTION_RULES
from contid.trajectory.pursuit import AxisRates, MovingAxes, pursued

#: Rows further apart are targets of their own; they have no clock [s].
SPARSE_S: Final = 0.25
#: How many periods a row is played after it was meant: the curve needs two rows more.
LAG: Final = 2.0
#: Memory of the period [s], and of the greatest lateness.
WINDOW_S: Final = 1.0
FORGET_S: Final = 8.0
#: What a row may be late besides, as a part of a tick.
MARGIN: Final = 0.1
#: Rows, and ticks, before a period is trusted, and the shortest one [s].
FIRST: Final = 3
LEARN_TICKS: Final = 6
SHORTEST_S: Final = 1e-4
#: A row that is off by this many periods, and by this time [s], belongs to another clock.
OFF_PERIODS: Final = 3.0
OFF_S: Final = 0.1
#: Ticks after which a row does not belong to those that arrived together, and bursts that are left out.
QUEUED_TICKS: Final = 1.5
BURSTS: Final = 3
#: Rate of the filter of the phase [1/s], and the greatest error that it takes up [rows, s].
FOLLOW_PER_S: Final = 8.0
GREATEST_ERROR: Final = 4.0
GREATEST_S: Final = 0.05
#: Greatest rate of the phase with a new period, in rows per period.
FASTEST: Final = 3.0
#: A phase is on a row, and at rest, within this part of it.
_THERE: Final = 1e-9


class RowClock:
    """Learns a clock row by row, and plays it tick by tick.

    Attributes:
        newest: number of the newest row.
        period_s: learnt period, 0 while it is not known.
        late_s: greatest lateness of the last seconds.
        phase: which row is played, between two rows a fraction.
    """

    def __init__(self, tick_s: float, rules: int = MOTION_RULES) -> None:
        """``tick_s``: period of the ticks, at which rows arrive; ``rules``: of motion."""
        self._rejects_queued = rules > 3
        self._tick_s = tick_s
        self._margin_s = MARGIN * tick_s
        self.newest = -1
        self.period_s = 0.0
        self.late_s = 0.0
        self.phase = -LAG
        self._rate = self._bend = 0.0  # of the phase [1/s, 1/s^2]
        self._seen = 0
        self._gaps_s = (0.0, 0.0)  # of the newest rows
        self._motion: MovingAxes | None = None  # of the phase to rest
        self._stands = False
        self._bursts = 0  # before a period was learnt
        self._meant_s = self._arrived_s = 0.0  # of the newest row
        self._began_s = 0.0  # arrival of the first row of this clock
        self._learnt_s = 0.0  # period while it is not trusted

    @property
    def delay_s(self) -> float:
        """How long after it was meant a row is played; 0 without a clock."""
        return LAG * self.period_s + self.late_s + self._margin_s if self.period_s else 0.0

    def expected(self, now_s: float) -> float:
        """By how many rows a row that arrives now comes after the newest."""
        return (now_s - self._meant_s) / self.period_s if self.period_s else 1.0

    def arrived(self, now_s: float, rows: int = 1) -> None:
        """A row arrived.

        Args:
            now_s: when.
            rows: how many rows after the newest, at least 1; more after rows that were lost.
        """
        gap_s = now_s - self._arrived_s
        self._motion = None
        if self._seen == 0 or gap_s > SPARSE_S:
            self._restart(now_s, 0.0)
            self._bursts = 0
        elif self._stands:
            self._restart(now_s, self.period_s)
        elif self.period_s and self._changed(gap_s, now_s):
            self._restart(now_s, gap_s)
            self.late_s = 0.0
        elif not self.period_s and self._burst(gap_s):
            # Rows that had waited, as for the run to begin, arrived at once.
            self._restart(now_s, 0.0)
            self._bursts += 1
        else:
            self._learn(now_s, gap_s, rows)
        self._stands = False
        self._arrived_s = now_s
        self._gaps_s = (self._gaps_s[1], gap_s)

    def _burst(self, gap_s: float) -> bool:
        """True when the rows before came faster than this one after them; some producers write in bursts."""
        late = gap_s > OFF_PERIODS * self._learnt_s + QUEUED_TICKS * self._tick_s
        return self._seen > 1 and late and self._bursts < BURSTS

    def _changed(self, gap_s: float, now_s: float) -> bool:
        """True when three gaps in a row agree on another period.

        Rows that waited while their producer or its host stood still come at once as well, but late.
        """
        if self._rejects_queued and gap_s < self.period_s <= now_s - self._meant_s + self._tick_s:
            return False
        gaps_s = (*self._gaps_s, gap_s)
        other = min(abs(each - self.period_s) for each in gaps_s) > 0.25 * self.period_s + 0.5 * self._tick_s
        return other and max(gaps_s) - min(gaps_s) <= self._tick_s * (1.0 + 1e-6)

    def _learn(self, now_s: float, gap_s: float, rows: int) -> None:
        period_s = self.period_s or self._learnt_s
        self.newest += rows
        self._seen += 1
        ahead_s = self._meant_s + rows * period_s
        off_s = now_s - ahead_s
        if self.period_s and abs(off_s) > max(OFF_PERIODS * period_s, OFF_S) + self.late_s:
            self._restart(now_s, self.period_s)
            return
        if self.period_s and self._rejects_queued:
            # One late row has a bounded weight; those that waited behind it are the same lateness again.
            off_s = min(off_s, self._tick_s if gap_s <= self._tick_s else period_s)
        k = min(float(self._seen), max(8.0, WINDOW_S / period_s) if period_s > 0.0 else float(self._seen))
        self._meant_s = ahead_s + 2.0 * (2.0 * k - 1.0) / (k * (k + 1.0)) * off_s
        self._learnt_s = period_s = period_s + 6.0 / (k * (k + 1.0)) * off_s / rows
        long_enough = self._seen >= FIRST and now_s - self._began_s >= LEARN_TICKS * self._tick_s
        if self.period_s or (long_enough and period_s > SHORTEST_S):
            first = not self.period_s
            self.period_s = max(period_s, SHORTEST_S)
            if first:
                self.phase, self._rate, self._bend = self._due(now_s), 1.0 / self.period_s, 0.0
        self.late_s = max(self.late_s * (1.0 - min(1.0, period_s / FORGET_S)), now_s - self._meant_s)

    def _restart(self, now_s: float, period_s: float) -> None:
        """Begin to learn anew, with the row that arrived; the phase goes on."""
        self.newest = max(self.newest + 1, int(self.phase) + 3)
        self._seen = 1
        self._meant_s = self._began_s = now_s
        self._learnt_s = period_s
        self.period_s = period_s
        if period_s and self._rate > FASTEST / period_s:
            self._rate, self._bend = FASTEST / period_s, 0.0
        self.late_s = 0.0 if not period_s else self.late_s

    def _due(self, now_s: float) -> float:
        """Which row is to be played now."""
        return self.newest + (now_s - self._meant_s - self.late_s - self._margin_s) / self.period_s - LAG

    @property
    def rate_per_s(self) -> float:
        """Rows played per second."""
        return self._rate

    def missing(self) -> float:
        """How many rows after the newest the curve needs now."""
        return math.floor(self.phase) + LAG - self.newest

    @property
    def stopping(self) -> bool:
        """True on the way of the phase to rest."""
        return self._motion is not None

    def stop(self, acceleration: float, jerk: float, forward: bool = False) -> bool:
        """One tick of the way of the phase to rest on the newest row; True when it is there.

        A clock without a period has no such way: its rows are targets of their own.

        Args:
            acceleration: greatest one of the phase [1/s^2].
            jerk: greatest one [1/s^3].
            forward: from rest where the phase ran backwards, after a change of the period, and within
                ``acceleration``.
        """
        h, now, row = self._tick_s, self._motion, float(self.newest)
        if now is None:
            rate, bend = self._rate + 0.5 * self._bend * h, self._bend
            if forward:
                rate, bend = (
                    max(rate, 0.0),
                    min(max(bend, -acceleration), acceleration) if rate > 0.0 else 0.0,
                )
            now = MovingAxes((self.phase,), (rate,), (bend,))
        top = 2.0 * max(abs(now.velocity[0]), 1.0 / self.period_s)
        after = pursued(now, (row,), (0.0,), AxisRates((top,), (acceleration,), (jerk,)), h)
        there = after is None or (
            abs(after.position[0] - row) < _THERE and abs(after.velocity[0]) < _THERE * top
        )
        if after is None or there:
            self.phase, self._rate, self._bend, self._motion = row, 1.0 / self.period_s, 0.0, None
            self._stands = True
            return True
        self.phase, self._rate, self._bend, self._motion = (
            after.position[0],
            after.velocity[0],
            after.acceleration[0],
            after,
        )
        return False

    def play(self, now_s: float) -> float:
        """The phase at a tick."""
        if not self.period_s or self._stands:
            return self.phase
        error = self._due(now_s) - self.phase
        if abs(error) > GREATEST_ERROR + SPARSE_S / self.period_s:  # it follows another clock
            self.phase, self._rate, self._bend = self.phase + error, 1.0 / self.period_s, 0.0
            return self.phase
        most = max(GREATEST_ERROR, GREATEST_S / self.period_s)
        error = min(max(error, -most), most)
        w = FOLLOW_PER_S
        jolt = w * (w * (w * error + 3.0 * (1.0 / self.period_s - self._rate)) - 3.0 * self._bend)
        self._bend += jolt * self._tick_s
        self._rate += self._bend * self._tick_s
        self.phase += self._rate * self._tick_s
        return self.phase
