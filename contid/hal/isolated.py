"""Options of a bus that has a process of its own: what the tick needs of them, without its driver."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from contid.hal.response import DeviceResponse


class IsolatedBusOptions(BaseModel):
    """Of the bus.

    Attributes:
        watchdog_ms: of its devices, None without one.
        body: what builds the bus, pickled; only its own process reads it.
    """

    model_config = ConfigDict(frozen=True)

    watchdog_ms: float | None
    body: bytes


class IsolatedAxisOptions(BaseModel):
    """Of an axis.

    Attributes:
        response: of its device.
    """

    model_config = ConfigDict(frozen=True)

    response: DeviceResponse
