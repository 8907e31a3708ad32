"""The clock of a producer of rows: when each row was meant, learnt from when rows arrived.

Row n of a producer with a period T is meant at ``t0 + n T`` and arrives later, by a part that varies. Both
numbers are learnt by least squares over all rows, from `WINDOW_S` on with fading memory (an alpha-beta filter
whose gains are those of a growing least-squares fit: E. Brookner, "Tracking and Kalman Filtering Made Easy",
1998, section 1.2.10). Learning begins anew after a silence, where gaps agree on another period, and where a
row arrives far from when it was meant. A clock that keeps its period then learns only when its rows are meant
again; rows that come at once had waited, and the last of them is the one that is in time. (By motion rules
before 10 it learnt its period anew, from such rows one that was far too short.)
"""

from __future__ import annotations

import enum
from collections import deque
from typing import Final

from contid.control.tick.config import MOTION_RULES

#: Rows further apart are targets of their own; they have no clock [s].
SPARSE_S: Final = 0.25
#: Memory of the period [s], and of the greatest lateness.
WINDOW_S: Final = 1.0
FORGET_S: Final = 8.0
#: Rows, and ticks, before a period is trusted, and the shortest one [s].
FIRST: Final = 3
LEARN_TICKS: Final = 6
SHORTEST_S: Final = 1e-4
#: A row that is off by this many periods, and by this time [s], belongs to another clock.
OFF_PERIODS: Final = 3.0
OFF_S: Final = 0.1
#: How long gaps agree on another period before it is taken [s]: longer than a busy machine stands still.
CHANGED_S: Final = 0.06
CHANGED_GAPS: Final = 3
#: How long after it began a clock does not learn a shorter period from rows that come early [s].
CAUGHT_UP_S: Final = 0.2
#: Ticks after which a row does not belong to those that arrived together, and bursts that are left out.
QUEUED_TICKS: Final = 1.5
BURSTS: Final = 3


class Lesson(enum.Enum):
    """What a row taught by its arrival."""

    #: The clock, a little better; or nothing that suffices for a period.
    MORE = enum.auto()
    #: A period, which was not known before.
    PERIOD = enum.auto()
    #: That another clock begins with this row.
    ANEW = enum.auto()


class ProducerClock:
    """Learns a clock row by row.

    Attributes:
        newest: number of the newest row.
        period_s: learnt period, 0 while it is not known.
        late_s: greatest lateness of the last seconds.
        meant_s: when the newest row was meant.
    """

    def __init__(self, tick_s: float, rules: int = MOTION_RULES) -> None:
        """``tick_s``: period of the ticks, at which rows arrive; ``rules``: of motion."""
        self._rejects_queued, self._keeps_period = rules > 3, rules > 9
        self._tick_s = tick_s
        self.newest = -1
        self.period_s = self.late_s = self.meant_s = 0.0
        self._fitted_s = 0.0  # the period of the fit, before it is trusted
        self._rows = self._since = 0  # by which the period is learnt, and since the clock began
        self._began_s = 0.0  # arrival of its first row
        self._arrived_s = 0.0  # arrival of the newest row
        self._changed_s = CHANGED_S if rules > 8 else 0.0
        self._gaps_s = deque([0.0, 0.0], 64)  # between the last rows
        self._bursts = 0  # before a period was learnt

    @property
    def longest_period_s(self) -> float:
        """The longest that the rows of this clock allow: arrivals vary by ticks and by lateness."""
        return self.period_s + (self._tick_s + self.late_s) / max(self._rows - 1, 1)

    def learn(self, now_s: float, rows: int, used: int, stood: bool) -> Lesson:
        """A row arrived.

        Args:
            now_s: when.
            rows: how many rows after the newest, at least 1; more after rows that were lost.
            used: number of the last row that the curve used; a clock that begins counts on from there.
            stood: the curve had come to rest.
        """
        gap_s = now_s - self._arrived_s
        if self._rows == 0 or gap_s > SPARSE_S:
            self._bursts = 0
            lesson = self._begin(now_s, 0.0, used)
        elif stood:
            lesson = self._begin(now_s, self.period_s, used)
        elif self.period_s and self._changed(gap_s, now_s):
            self.late_s, self._rows = 0.0, 0
            lesson = self._begin(now_s, gap_s, used)
        elif self._since == 1 and self._waited(gap_s):
            lesson = self._begin(now_s, self.period_s, self.newest)
        elif not self.period_s and self._burst(gap_s):
            # Rows that had waited, as for the run to begin, arrived at once.
            self._bursts += 1
            lesson = self._begin(now_s, 0.0, used)
        else:
            lesson = self._fit(now_s, gap_s, rows, used)
        self._arrived_s = now_s
        self._gaps_s.append(gap_s)
        return lesson

    def _begin(self, now_s: float, period_s: float, used: int) -> Lesson:
        """Begin to learn anew with the row that arrived, from a period that it may have; 0 for none."""
        self.newest = max(self.newest, used) + 1
        self._rows = max(self._rows, 1) if period_s and self._keeps_period else 1
        self._since = 1
        self.meant_s = self._began_s = now_s
        self._fitted_s = self.period_s = period_s
        self.late_s = self.late_s if period_s else 0.0
        return Lesson.ANEW

    def _waited(self, gap_s: float) -> bool:
        """True when a row comes so soon after that with which a clock began again that both had waited."""
        return self._keeps_period and gap_s < 0.5 * self.period_s

    def _burst(self, gap_s: float) -> bool:
        """True when the rows before came faster than this one after them; some producers write in bursts."""
        late = gap_s > OFF_PERIODS * self._fitted_s + QUEUED_TICKS * self._tick_s
        return self._rows > 1 and late and self._bursts < BURSTS

    def _changed(self, gap_s: float, now_s: float) -> bool:
        """True when gaps in a row, three and as long as `CHANGED_S`, agree on another period.

        Rows that waited while their producer or its host stood still come at once as well, but late.
        """
        if self._rejects_queued and gap_s < self.period_s <= now_s - self.meant_s + self._tick_s:
            return False
        least_s = 0.25 * self.period_s + 0.5 * self._tick_s
        if not abs(gap_s - self.period_s) > least_s:  # most rows
            return False
        gaps_s = self._newest_gaps(gap_s)
        if sum(gaps_s) < self._changed_s:
            return False
        other = min(abs(each - self.period_s) for each in gaps_s) > least_s
        return other and max(gaps_s) - min(gaps_s) <= self._tick_s * (1.0 + 1e-6)

    def _newest_gaps(self, gap_s: float) -> list[float]:
        """The newest gaps, three or as many as `CHANGED_S` has, from the newest one back."""
        gaps_s, long_s = [gap_s], gap_s
        for each_s in reversed(self._gaps_s):
            if len(gaps_s) >= CHANGED_GAPS and long_s >= self._changed_s:
                break
            gaps_s.append(each_s)
            long_s += each_s
        return gaps_s

    def _fit(self, now_s: float, gap_s: float, rows: int, used: int) -> Lesson:
        """Take the row into the fit."""
        learnt, period_s = self.period_s > 0.0, self.period_s or self._fitted_s
        ahead_s = self.meant_s + rows * period_s
        off_s, catching_up = now_s - ahead_s, now_s - self._began_s < CAUGHT_UP_S
        if learnt and abs(off_s) > max(OFF_PERIODS * period_s, OFF_S) + self.late_s:
            if off_s < 0.0 and not catching_up:  # rows that come ever earlier have a shorter period
                self._rows = 0
            return self._begin(now_s, period_s, 0 if self._keeps_period else max(self.newest + rows, used))
        self.newest += rows
        self._rows += 1
        self._since += 1
        if learnt and self._rejects_queued:
            # One late row has a bounded weight; those that waited behind it are the same lateness again.
            off_s = min(off_s, self._tick_s if gap_s <= self._tick_s else period_s)
            if self._keeps_period and catching_up:
                off_s = max(off_s, -period_s)
        k = float(self._rows)
        if period_s > 0.0:
            k = min(k, max(8.0, WINDOW_S / period_s))
        # With the period known, the mean of all rows since the clock began is the least-squares fit.
        gain = max(2.0 * (2.0 * k - 1.0) / (k * (k + 1.0)), 1.0 / self._since)
        self.meant_s = ahead_s + gain * off_s
        self._fitted_s = period_s = period_s + 6.0 / (k * (k + 1.0)) * off_s / rows
        long_enough = self._rows >= FIRST and now_s - self._began_s >= LEARN_TICKS * self._tick_s
        if learnt or (long_enough and period_s > SHORTEST_S):
            self.period_s = max(period_s, SHORTEST_S)
        self.late_s = max(self.late_s * (1.0 - min(1.0, period_s / FORGET_S)), now_s - self.meant_s)
        return Lesson.PERIOD if self.period_s and not learnt else Lesson.MORE
