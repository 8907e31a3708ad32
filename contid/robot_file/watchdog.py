"""A rate and the devices' dead-men: ticks feed them, so ticks must come often enough."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, Protocol

from pydantic import BaseModel

#: A dead-man outlasts one tick that was lost.
_PERIODS: Final = 2.0


class _Bus(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def options(self) -> BaseModel: ...


def watchdog_too_short(buses: Iterable[_Bus], rate_hz: float) -> Iterator[str]:
    """What is wrong with a rate, for every bus whose driver has the option ``watchdog_ms``."""
    for bus in buses:
        watchdog_ms = getattr(bus.options, "watchdog_ms", None)
        if isinstance(watchdog_ms, int | float) and watchdog_ms * rate_hz < _PERIODS * 1e3:
            least = _PERIODS * 1e3 / watchdog_ms
            yield (
                f"{rate_hz:g} Hz feeds the dead-man of bus {bus.name!r} (watchdog_ms {watchdog_ms:g}) "
                f"too late; allowed is at least {least:g} Hz, or a longer watchdog_ms"
            )
