"""Check of the tick rate against the time of an exchange on the wire, where a driver can compute it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, Protocol

from pydantic import BaseModel

from contid.hal import ExchangeTime, Finding, Paces, load_driver

#: Share of a period an exchange may take; the rest is for the computation of the tick.
SHARE: Final = 0.9
#: Slower rates are written with decimals.
_WHOLE_HZ: Final = 10.0


class _PacedBus(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def driver(self) -> str: ...
    @property
    def options(self) -> BaseModel: ...
    @property
    def axes(self) -> Sequence[tuple[str, BaseModel]]: ...


def exchange_time(bus: _PacedBus) -> ExchangeTime | None:
    """Time of an exchange of a bus; None when its driver does not compute it, or without axes."""
    driver = load_driver(bus.driver)
    if not isinstance(driver, Paces) or not bus.axes:
        return None
    return driver.exchange_time(bus.options, [options for _, options in bus.axes])


def highest_rate_hz(time: ExchangeTime) -> float:
    """Highest rate that fits with plain reads and a slow adapter [Hz], rounded down."""
    rate_hz = SHARE / time.most_s
    return float(math.floor(rate_hz)) if rate_hz >= _WHOLE_HZ else math.floor(rate_hz * 100.0) / 100.0


def rate_too_high(buses: Iterable[_PacedBus], rate_hz: float) -> Iterator[str]:
    """A message for every bus whose wire cannot carry a rate."""
    for bus in buses:
        time = exchange_time(bus)
        if time is not None and time.least_s * rate_hz > 1.0:
            yield (
                f"{rate_hz:g} Hz is too fast for the wire of bus {bus.name!r}: {time.what} need "
                f"{time.least_s * 1e3:.3g} ms per exchange, a period is {1e3 / rate_hz:.3g} ms; "
                f"allowed is at most {highest_rate_hz(time):g} Hz, or a higher baud rate"
            )


def rate_finding(name: str, time: ExchangeTime, rate_hz: float) -> Finding:
    """The result of comparing a rate with the time of an exchange."""
    subject, period_ms, rate = f"{name} wire", 1e3 / rate_hz, f"{rate_hz:g} Hz"
    least_ms, most_ms = time.least_s * 1e3, time.most_s * 1e3
    message = f"{time.what}: {least_ms:.3g} to {most_ms:.3g} ms of the {period_ms:.3g} ms at {rate}"
    highest = highest_rate_hz(time)
    if most_ms <= SHARE * period_ms:
        return Finding(subject, True, f"{message}; at most {highest:g} Hz fit")
    remedy = f"at most {highest:g} Hz fit in every case: lower rate_hz, or raise the baud rate"
    if least_ms > period_ms:
        return Finding(subject, False, message, remedy)
    return Finding(subject, True, f"{message}: not with plain reads and a slow adapter", remedy, warning=True)
