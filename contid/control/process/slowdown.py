"""What gives way, in a fixed order, while ticks do not fit into their period: telemetry first, then the rate.

    0  as planned
    1  clients get at most `TELEMETRY_HZ` frames per second
    2  ticks come half as often, and every robot moves at half its speed: its time counts ticks
    3  a quarter as often

A level is left upwards after a window of `WINDOW_S` in which more than `OVERLOADED` of the ticks were
skipped, level 0 after two, level 1 only where the ticks themselves take too long. It is left downwards
after calm windows in which a tick took at most `FITS` of the period of the level below. The period changes
by a ramp, by its length at level 0 in `RAMP_S`: robots brake and speed up within twice that. Ticks that come
later are not skipped ones; a recording has them all, and replays. Pure arithmetic on given times.
"""

from __future__ import annotations

import math
from typing import Final

from contid.control.engine.events.buses import OverloadChanged

#: Length of a window [s], and the fewest ticks of one.
WINDOW_S: Final = 1.0
LEAST_TICKS: Final = 10
#: Share of skipped ticks above which a window is overloaded, and share of a period that fits.
OVERLOADED: Final = 0.1
FITS: Final = 0.6
#: How long ticks have to fit before a level is left [s]; twice as long after each return of the overload.
CALM_S: Final = 5.0
LONGEST_CALM_S: Final = 80.0
#: How many times the period, by level; time in which it changes by one period.
FACTORS: Final = (1.0, 1.0, 2.0, 4.0)
RAMP_S: Final = 0.5


class Slowdown:
    """The level, window by window.

    Attributes:
        level: 0 to 3.
        factor: how many times its length the period is now.
    """

    def __init__(self, rate_hz: float, longest_s: float = math.inf) -> None:
        """``longest_s``: longest period that the watchdogs of the devices allow."""
        self.level, self.factor = 0, 1.0
        self._rate_hz = rate_hz
        self._top = max(k for k, each in enumerate(FACTORS) if k < 2 or each / rate_hz <= longest_s)
        self._calm_needed_s = 0.5 * CALM_S
        self._overloads = 0  # windows in a row
        self._begin_window(-math.inf)
        self._calm_since_s = -math.inf

    def _begin_window(self, now_s: float) -> None:
        self._since_s, self._ticks, self._skipped, self._worked_s = now_s, 0, 0, 0.0

    def tick(self, now_s: float, skipped: int, worked_s: float) -> OverloadChanged | None:
        """A tick begins; the change of the level, if there is one.

        Args:
            now_s: the current time.
            skipped: ticks left out before it.
            worked_s: how long the tick before took.
        """
        goal = FACTORS[self.level]
        if self.factor != goal:
            step = self.factor / self._rate_hz / RAMP_S
            self.factor = (
                min(self.factor + step, goal) if goal > self.factor else max(self.factor - step, goal)
            )
            self._begin_window(now_s)
            self._calm_since_s = now_s
            return None
        if self._since_s == -math.inf:
            self._begin_window(now_s)
            self._calm_since_s = now_s
        self._ticks += 1
        self._skipped += skipped
        self._worked_s += worked_s
        if now_s < self._since_s + WINDOW_S or self._ticks < LEAST_TICKS:
            return None
        overloaded = self._skipped > OVERLOADED * (self._ticks + self._skipped)
        work_s = self._worked_s / self._ticks
        self._begin_window(now_s)
        self._overloads = self._overloads + 1 if overloaded else 0
        if overloaded:
            self._calm_since_s = now_s
            if not self.level:
                return self._change(1, work_s) if self._overloads > 1 else None
            # Where ticks fit and come late all the same, the machine is busy: robots are not slowed for that.
            fits = work_s * self._rate_hz <= FITS * FACTORS[self.level]
            return None if fits else self._change(1, work_s)
        if not self.level:
            return None
        if work_s * self._rate_hz > FITS * FACTORS[self.level - 1]:
            self._calm_since_s = now_s
        if now_s - self._calm_since_s < self._calm_needed_s:
            return None
        self._calm_since_s = now_s
        return self._change(-1, work_s)

    def _change(self, by: int, work_s: float) -> OverloadChanged | None:
        """One level up or down."""
        if self.level + by > self._top:
            return None
        if by > 0 and self.level == 0:
            self._calm_needed_s = min(2.0 * self._calm_needed_s, LONGEST_CALM_S)
        self.level += by
        return OverloadChanged(
            level=self.level,
            rate_hz=self._rate_hz / FACTORS[self.level],
            full_rate_hz=self._rate_hz,
            work_ms=round(1e3 * work_s, 3),
        )
