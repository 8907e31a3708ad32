"""The monotonic clock of the machine, and a virtual one.

A bus gets one of these (`contid.hal.Clock`). Nothing in the tick reads any other clock, which is what makes
a run in virtual time repeatable to the bit.
"""

from __future__ import annotations

import time


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
