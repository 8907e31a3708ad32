"""Types shared by the engine and its callers: clocks, the timing of a cycle, the sink, the end of a run.

A bus gets one of the clocks (`contid.hal.Clock`). Nothing in the tick reads any other clock, which is what
makes a run in virtual time repeatable to the bit.
"""

from __future__ import annotations

import enum
import time
from typing import Protocol

from contid.control.engine.events import RunEvent
from contid.records import record


class RealClock:
    """CLOCK_MONOTONIC: immune to the steps of the wall clock, the same for every process of the machine."""

    #: Seconds since the machine started, and a wait [s].
    now = staticmethod(time.monotonic)
    sleep = staticmethod(time.sleep)


class VirtualClock:
    """A clock that advances by `set` and `sleep` only."""

    def __init__(self, now_s: float = 0.0) -> None:
        self._now_s = now_s

    def now(self) -> float:
        """The time last set [s]."""
        return self._now_s

    def set(self, now_s: float) -> None:
        """Move the clock forward to ``now_s``.

        Raises:
            ValueError: time would run backwards.
        """
        if now_s < self._now_s:
            raise ValueError(f"time runs forward: {now_s} is before {self._now_s}")
        self._now_s = now_s

    def sleep(self, seconds: float) -> None:
        """Advance the clock, as a device that answers late does."""
        self.set(self._now_s + seconds)


class OnEnd(enum.StrEnum):
    """What happens when the trajectory or the stream ends."""

    STOP = "stop"  # the robot file's stop.on_end, then the run ends
    REST = "rest"  # move to the rest pose, hold there, then the run ends
    HOLD = "hold"  # hold until an order


class Sink(Protocol):
    """Where records and events go: a ring, a log, or both."""

    def write(self, values: list[float]) -> None:
        """One tick: all values of its `contid.control.engine.tick_layout.RecordLayout` in order."""
        ...

    def event(self, event: RunEvent) -> None:
        """One event."""
        ...


@record(frozen=True, slots=True)
class Timing:
    """The timing of one cycle.

    Attributes:
        tick: its number.
        skipped: ticks skipped since the start.
        deadline_s: when it should have started, on the clock of the buses.
        lateness_s: how much later it started.
        end_s: until when `contid.control.engine.exchange.Exchange` waits for answers of buses with workers of
            their own, on the clock of the buses; it waits for a least share of the period in any case. 0 in
            virtual time and in replay, which have no such buses.
    """

    tick: int
    skipped: int
    deadline_s: float
    lateness_s: float = 0.0
    end_s: float = 0.0
