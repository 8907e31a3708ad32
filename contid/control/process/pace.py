"""Deadlines of ticks, the count of late and skipped ones, and the longest time without a tick.

    deadline(n) = base + n / rate        on CLOCK_MONOTONIC

A deadline that passed a whole period ago is skipped and counted, in every state. Only while devices are
connected, armed or cleared, which may take longer than a period, and no robot moves, the grid is shifted
instead, and it is stretched while ticks do not fit (`contid.control.process.slowdown`). Pure arithmetic on
given times.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from contid.control.engine import messages as msg
from contid.control.engine.cycle import Sink, Timing
from contid.control.engine.events.buses import PaceReported, TicksSkipped, TicksWaited
from contid.control.engine.events.robots import OrderRefused
from contid.control.process.slowdown import Slowdown
from contid.control.tick.statistics import Lateness

#: A tick that starts later than this share of the period counts as late.
LATE_SHARE: Final = 0.1
#: A bus with its own worker thread must answer within this share of the period.
BUS_SHARE: Final = 0.9
#: Periods from the start to the first deadline.
START_PERIODS: Final = 2.0
#: Shortest interval between two ``skipped`` and between two ``waited`` events.
REPORT_INTERVAL_S: Final = 1.0


class Pace:
    """The grid of deadlines of one run, and its statistics."""

    def __init__(
        self,
        rate_hz: float,
        now_s: float,
        sink: Sink,
        cause: Callable[[float, float], str] = lambda start_s, due_s: "",
        worked: Callable[[], float] = lambda: 0.0,
        longest_s: float = math.inf,
    ) -> None:
        """Begin a grid `START_PERIODS` from now.

        Args:
            rate_hz: of the tick.
            now_s: the current time.
            sink: gets the ``skipped`` and ``waited`` events.
            cause: of skipped ticks, by the times when a tick starts and when it was due.
            worked: how long the newest tick took [s].
            longest_s: longest period that the watchdogs of the devices allow.
        """
        self._slowdown, self._worked = Slowdown(rate_hz, longest_s), worked
        self._period_s = 1.0 / rate_hz
        self._base_s = now_s + START_PERIODS * self._period_s
        self._sink = sink
        self._tick = 0
        self._ticks = self._late = self._skipped = self._waited = 0
        self._lateness = Lateness()
        self._started_s = now_s
        self._longest_gap_s = 0.0
        self._unreported = self._unreported_waits = 0
        self._find_cause, self._cause, self._most_missed = cause, "", 0
        self._reported_s = self._waits_reported_s = 0.0

    @property
    def deadline_s(self) -> float:
        """When the next tick is due."""
        return self._base_s + self._tick * self._period_s

    def begin(self, start_s: float, preparing: bool) -> Timing:
        """Start a tick.

        Args:
            start_s: the current time.
            preparing: the tick before may have taken longer for a request to devices (see
                `contid.control.engine.engine.Engine.preparing`); missed deadlines shift the grid.
        """
        more = self._slowdown.factor - 1.0
        period_s = self._period_s * (1.0 + more)
        delay_s = start_s - self.deadline_s
        missed = 0
        if delay_s >= period_s:
            missed = int(delay_s / period_s)
            self._longest_gap_s = max(self._longest_gap_s, start_s - self._started_s)
            if preparing:
                self._base_s += missed * period_s
                self._waited += missed
                self._unreported_waits += missed
                delay_s -= missed * period_s
            else:
                self._tick += missed
                self._base_s += missed * more * self._period_s
                self._skipped += missed
                self._unreported += missed
                if missed > self._most_missed:
                    self._most_missed, self._cause = missed, self._find_cause(start_s, start_s - delay_s)
        if self._unreported or self._unreported_waits:
            self._report_missed(start_s)
        self._started_s = start_s
        deadline_s = self.deadline_s
        lateness_s = max(start_s - deadline_s, 0.0)
        # The histogram holds the whole delay, including skipped periods.
        self._lateness.add(max(delay_s, 0.0))
        self._ticks += 1
        self._late += lateness_s > LATE_SHARE * period_s
        timing = Timing(self._tick, self._skipped, deadline_s, lateness_s, deadline_s + BUS_SHARE * period_s)
        self._tick += 1
        change = None if preparing else self._slowdown.tick(start_s, missed, self._worked())
        if change is not None:
            self._sink.event(change)
        self._base_s += (self._slowdown.factor - 1.0) * self._period_s
        return timing

    def report(self) -> PaceReported:
        """The statistics so far."""
        return PaceReported(
            ticks=self._ticks,
            late=self._late,
            skipped=self._skipped,
            waited=self._waited,
            lateness=self._lateness.as_dict(),
            longest_gap_ms=self._longest_gap_ms,
        )

    @property
    def _longest_gap_ms(self) -> float:
        return round(self._longest_gap_s * 1e3, 3)

    def _report_missed(self, now_s: float) -> None:
        """Report skipped ticks and periods waited for, each at most once per `REPORT_INTERVAL_S`."""
        if self._unreported and now_s - self._reported_s >= REPORT_INTERVAL_S:
            self._sink.event(
                TicksSkipped(
                    ticks=self._unreported,
                    total=self._skipped,
                    longest_gap_ms=self._longest_gap_ms,
                    cause=self._cause,
                )
            )
            self._reported_s, self._unreported, self._most_missed = now_s, 0, 0
        if self._unreported_waits and now_s - self._waits_reported_s >= REPORT_INTERVAL_S:
            self._sink.event(
                TicksWaited(
                    ticks=self._unreported_waits, total=self._waited, longest_gap_ms=self._longest_gap_ms
                )
            )
            self._waits_reported_s, self._unreported_waits = now_s, 0


#: Orders that cancel a planned start.
CANCELLING: Final = (msg.Hold, msg.Stop, msg.Estop, msg.Goto, msg.Rows, msg.Play, msg.Begin, msg.Finish)


class PlannedStart:
    """The start that is planned, if any.

    The trajectory begins in the tick whose deadline is nearest to the planned time: at most half a period
    away, unless ticks were skipped there. Times are on CLOCK_MONOTONIC [s].
    """

    def __init__(self, period_s: float) -> None:
        self._half_s = 0.5 * period_s
        self._at_s: float | None = None

    def plan(self, start: msg.Start, deadline_s: float, sink: Sink) -> None:
        """Plan a start; one whose time has passed at the deadline of this tick is refused."""
        if start.at_s + self._half_s < deadline_s:
            late_ms = (deadline_s - start.at_s) * 1e3
            message = f"the start came {late_ms:.1f} ms after its time; nothing began"
            sink.event(OrderRefused(message=message))
        else:
            self._at_s = start.at_s

    def cancel_for(self, message: object) -> None:
        """Cancel the planned start if the message is an order that moves or stops robots."""
        if isinstance(message, CANCELLING):
            self._at_s = None

    def due(self, deadline_s: float, start_s: float) -> msg.Go | None:
        """The order for the tick of a deadline that started at ``start_s``; None before the time."""
        if self._at_s is None or deadline_s + self._half_s < self._at_s:
            return None
        at_s, self._at_s = self._at_s, None
        return msg.Go(at_s, start_s)
