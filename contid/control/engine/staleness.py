"""The age class of the data of a bus, and the events of its changes.

    class = first of (fresh, late, stale, old, lost) whose bound is not exceeded

Bounds 15, 50, 200 and 1000 ms (those of orca_core's joint loop), none of them shorter than three periods of
the tick: at 20 Hz data of 150 ms are fresh.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from typing import Final

from contid.control.engine.cycle import Sink
from contid.control.engine.events.buses import StalenessChanged
from contid.hal import Sample


class Staleness(enum.StrEnum):
    """Age class of the data of a bus."""

    FRESH = "fresh"
    LATE = "late"
    STALE = "stale"
    OLD = "old"
    LOST = "lost"


BOUNDS_S: Final[tuple[tuple[float, Staleness], ...]] = (
    (0.015, Staleness.FRESH),
    (0.050, Staleness.LATE),
    (0.200, Staleness.STALE),
    (1.000, Staleness.OLD),
)
#: Every bound is at least this many periods of the tick.
MIN_PERIODS: Final = 3.0
#: A better class is reported after this time, so a device at a bound does not flood the session.
RECOVERY_S: Final = 0.5
_ORDER: Final = {tier: place for place, tier in enumerate(Staleness)}


def staleness_of(age_s: float, period_s: float) -> Staleness:
    """The class of an age."""
    for bound_s, tier in BOUNDS_S:
        if age_s <= max(bound_s, MIN_PERIODS * period_s):
            return tier
    return Staleness.LOST


class StalenessMonitor:
    """Reports changes of class: a worse one at once, a better one after `RECOVERY_S`."""

    def __init__(self, axes_of: Mapping[str, Sequence[str]], rate_hz: float, sink: Sink) -> None:
        """``axes_of``: axes by bus."""
        self._axes_of = {bus: tuple(axes) for bus, axes in axes_of.items()}
        self._period_s = 1.0 / rate_hz
        self._fresh_s = max(BOUNDS_S[0][0], MIN_PERIODS * self._period_s)
        self._recovery_ticks = max(math.ceil(RECOVERY_S * rate_hz), 1)
        self._sink = sink
        self._reported: dict[str, Staleness] = {}
        #: Exchanges in a row with a better class than the reported one, by bus.
        self._better: dict[str, int] = dict.fromkeys(self._axes_of, 0)

    def classify(self, tick: int, samples: Mapping[str, Sample], now_s: float) -> None:
        """Classify the samples of an exchange and report changes; the first class of a bus is not reported.

        Args:
            tick: number of the tick.
            samples: by axis.
            now_s: time on the clock of the samples [s].
        """
        for bus, axes in self._axes_of.items():
            read = [each.time_s for axis in axes if (each := samples.get(axis)) and each.value is not None]
            if not read or len(read) < len(axes):
                continue
            age_s = now_s - min(read)
            tier = Staleness.FRESH if age_s <= self._fresh_s else staleness_of(age_s, self._period_s)
            before = self._reported.setdefault(bus, tier)
            if tier is before:
                self._better[bus] = 0
                continue
            if _ORDER[tier] < _ORDER[before]:
                self._better[bus] += 1
                if self._better[bus] < self._recovery_ticks:
                    continue
            self._better[bus] = 0
            self._reported[bus] = tier
            self._sink.event(
                StalenessChanged(tick=tick, bus=bus, tier=str(tier), before=str(before), age_s=age_s)
            )
