"""When ticks are due, and what becomes of those that do not start in time.

    deadline(n) = base + n / rate        on CLOCK_MONOTONIC

A deadline that passed a whole period ago is skipped and counted, never caught up; while nothing moves the
grid is moved instead, because connecting and arming take their time and harm nobody. Pure arithmetic with the
time given; the control process sleeps.
"""

from __future__ import annotations

from typing import Any, Final

from contid.control.engine.cycle import Sink, Timing
from contid.control.tick.statistics import Lateness

#: Share of the period that a tick may start late before it counts as late.
LATE: Final = 0.1
#: Share of the period that a bus with its own worker may take.
BUS_SHARE: Final = 0.9
#: Periods from the beginning to the first deadline.
AHEAD: Final = 2.0
#: At most one message about skipped ticks in so many seconds.
QUIET_S: Final = 1.0


class Pace:
    """The grid of deadlines of one run, and its statistics."""

    def __init__(self, rate_hz: float, now_s: float, sink: Sink) -> None:
        """Begin a grid ``AHEAD`` of now; ``sink`` is told of skipped ticks."""
        self._period_s = 1.0 / rate_hz
        self._base_s = now_s + AHEAD * self._period_s
        self._sink = sink
        self._tick = 0
        self._ticks = self._late = self._skipped = self._waited = 0
        self._lateness = Lateness()
        self._untold = 0
        self._told_s = 0.0

    @property
    def deadline_s(self) -> float:
        """When the next tick is due."""
        return self._base_s + self._tick * self._period_s

    def begin(self, start_s: float, moving: bool) -> Timing:
        """A tick starts now.

        Args:
            start_s: the time it is.
            moving: a robot may be in motion, so deadlines that passed are skipped ticks.

        Returns:
            Which tick it is.
        """
        period_s = self._period_s
        delay_s = start_s - self.deadline_s
        if delay_s >= period_s:
            missed = int(delay_s / period_s)
            if moving:
                self._tick += missed
                self._skip(missed, start_s)
            else:
                self._base_s += missed * period_s
                self._waited += missed
                delay_s -= missed * period_s
        deadline_s = self.deadline_s
        lateness_s = max(start_s - deadline_s, 0.0)
        # The histogram keeps the whole delay, also the part that is told as skipped ticks.
        self._lateness.add(max(delay_s, 0.0))
        self._ticks += 1
        self._late += lateness_s > LATE * period_s
        timing = Timing(self._tick, self._skipped, deadline_s, lateness_s, deadline_s + BUS_SHARE * period_s)
        self._tick += 1
        return timing

    def report(self) -> dict[str, Any]:
        """The fields of the event ``report``."""
        return {
            "ticks": self._ticks,
            "late": self._late,
            "skipped": self._skipped,
            "waited": self._waited,
            "lateness": self._lateness.as_dict(),
        }

    def _skip(self, missed: int, now_s: float) -> None:
        """Count skipped ticks; tell at most once in `QUIET_S`."""
        self._skipped += missed
        self._untold += missed
        if now_s - self._told_s >= QUIET_S:
            self._sink.event("skipped", ticks=self._untold, total=self._skipped)
            self._told_s, self._untold = now_s, 0
