"""Check of the tick rate against the devices' watchdogs, which ticks refresh."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, Protocol

from pydantic import BaseModel

#: One lost tick must not trip a watchdog.
_PERIODS: Final = 2.0


class _Bus(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def options(self) -> BaseModel: ...


def watchdog_s(bus: _Bus) -> float:
    """Time after which the devices of a bus stop by themselves [s]; 0 without a ``watchdog_ms``."""
    watchdog_ms = getattr(bus.options, "watchdog_ms", None)
    return watchdog_ms / 1e3 if isinstance(watchdog_ms, int | float) else 0.0


def watchdog_too_short(buses: Iterable[_Bus], rate_hz: float) -> Iterator[str]:
    """A message for every bus whose ``watchdog_ms`` is too short for a rate."""
    for bus in buses:
        longest_s = watchdog_s(bus)
        if longest_s and longest_s * rate_hz < _PERIODS:
            rate_min_hz = _PERIODS / longest_s
            yield (
                f"{rate_hz:g} Hz is too slow for the watchdog of bus {bus.name!r} (watchdog_ms "
                f"{longest_s * 1e3:g}); allowed is at least {rate_min_hz:g} Hz, or a longer watchdog_ms"
            )
