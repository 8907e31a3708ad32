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


def watchdog_too_short(buses: Iterable[_Bus], rate_hz: float) -> Iterator[str]:
    """A message for every bus whose ``watchdog_ms`` is too short for a rate."""
    for bus in buses:
        watchdog_ms = getattr(bus.options, "watchdog_ms", None)
        if isinstance(watchdog_ms, int | float) and watchdog_ms * rate_hz < _PERIODS * 1e3:
            rate_min_hz = _PERIODS * 1e3 / watchdog_ms
            yield (
                f"{rate_hz:g} Hz is too slow for the watchdog of bus {bus.name!r} (watchdog_ms "
                f"{watchdog_ms:g}); allowed is at least {rate_min_hz:g} Hz, or a longer watchdog_ms"
            )
