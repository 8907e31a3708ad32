"""Checks of the tick rate: against the time of an exchange on the wire, and against watchdogs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final

from contid.hal import ExchangeTime, Finding, Paces, load_driver
from contid.robot_file.document import BusWiring

#: Share of a period an exchange may take; the rest is for the computation of the tick.
SHARE: Final = 0.9
#: Slower rates are written with decimals.
_WHOLE_HZ: Final = 10.0
_ROUNDING: Final = 1e-9
#: Ticks refresh the watchdogs of devices: one lost tick must not trip them.
_WATCHDOG_PERIODS: Final = 2.0


def exchange_time(bus: BusWiring) -> ExchangeTime | None:
    """Time of an exchange of a bus; None when its driver does not compute it, or without axes."""
    driver = load_driver(bus.driver)
    if not isinstance(driver, Paces) or not bus.axes:
        return None
    return driver.exchange_time(bus.options, [options for _, options in bus.axes])


def highest_rate_hz(time: ExchangeTime) -> float:
    """Highest rate that fits with plain reads and a slow adapter [Hz], rounded down."""
    return rounded_down(SHARE / time.most_s)


def rounded_down(rate_hz: float) -> float:
    """A rate that may be named as allowed: whole, or with two decimals below `_WHOLE_HZ`."""
    return float(math.floor(rate_hz)) if rate_hz >= _WHOLE_HZ else math.floor(rate_hz * 100.0) / 100.0


def rate_too_high(buses: Iterable[BusWiring], rate_hz: float) -> Iterator[str]:
    """A message for every bus whose wire cannot carry a rate."""
    for bus in buses:
        time = exchange_time(bus)
        if time is not None and time.least_s * rate_hz > 1.0:
            yield (
                f"{rate_hz:g} Hz is too fast for the wire of bus {bus.name!r}: {time.what} need "
                f"{time.least_s * 1e3:.3g} ms per exchange, a period is {1e3 / rate_hz:.3g} ms; "
                f"at most {highest_rate_hz(time):g} Hz fit in every case, "
                f"{rounded_down(1.0 / time.least_s):g} Hz are allowed; or raise the baud rate"
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


def watchdog_s(bus: BusWiring) -> float:
    """Time after which the devices of a bus stop by themselves [s]; 0 without a ``watchdog_ms``."""
    watchdog_ms = getattr(bus.options, "watchdog_ms", None)
    return watchdog_ms / 1e3 if isinstance(watchdog_ms, int | float) else 0.0


def watchdog_too_short(buses: Iterable[BusWiring], rate_hz: float) -> Iterator[str]:
    """A message for every bus whose ``watchdog_ms`` is too short for a rate."""
    for bus in buses:
        longest_s = watchdog_s(bus)
        if longest_s and longest_s * rate_hz < _WATCHDOG_PERIODS:
            # Rounded up: a rate that is named is allowed.
            rate_min_hz = math.ceil(_WATCHDOG_PERIODS / longest_s * 100.0 - _ROUNDING) / 100.0
            yield (
                f"{rate_hz:g} Hz is too slow for the watchdog of bus {bus.name!r} (watchdog_ms "
                f"{longest_s * 1e3:g}); allowed is at least {rate_min_hz:.10g} Hz, or a longer watchdog_ms"
            )
