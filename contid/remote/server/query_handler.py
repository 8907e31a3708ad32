"""What every client may ask without any right: who is there, how things stand, and telemetry."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any, Final, Protocol, TypeAlias

from contid import __version__
from contid.control.daemon.interfaces import RunControl
from contid.remote.protocol.wire import PROTOCOL, Code, Fields, RemoteError, RequestFields
from contid.remote.server.lease import Lease
from contid.remote.server.telemetry_view import DEFAULT_FIELDS, FIELDS, TelemetryView
from contid.remote.server.trackers import Trackers

#: Ticks that the lateness in ``status`` looks back.
LOOK_BACK: Final = 200
#: Frames per second that one client can get.
GREATEST_RATE_HZ: Final = 200.0


class Caller(Protocol):
    """The client that asks."""

    number: int
    name: str

    def tell(self, fields: Mapping[str, Any]) -> None:
        """Send it a notice."""
        ...

    def subscribe(self, rate_hz: float, robots: Sequence[str], fields: Sequence[str], events: bool) -> None:
        """Send it telemetry from now on."""
        ...

    def unsubscribe(self) -> None:
        """No more telemetry, no more events."""
        ...


#: Carries out one verb for a client: its fields to the result of the answer.
Verb: TypeAlias = Callable[[Caller, RequestFields], Awaitable[Fields]]


class QueryHandler:
    """The verbs that change nothing.

    Attributes:
        verbs: by name.
    """

    def __init__(
        self,
        orders: RunControl,
        picture: TelemetryView,
        right: Lease,
        trackers: Trackers,
        clients: Callable[[], int],
    ) -> None:
        """Read from all of these; ``clients`` counts who is connected."""
        self._orders = orders
        self._picture = picture
        self._right = right
        self._trackers = trackers
        self._clients = clients
        self._began_s = time.monotonic()
        self._realtime: bool | None = None
        self.verbs: dict[str, Verb] = {
            "hello": self._hello, "ping": self._ping, "status": self._status, "describe": self._describe,
            "subscribe": self._subscribe, "unsubscribe": self._unsubscribe,
        }  # fmt: skip

    def notice(self, event: Mapping[str, Any]) -> None:
        """An event of the ring."""
        if event["event"] == "started":
            self._realtime = bool(event["realtime"])

    def hello(self) -> Fields:
        """The first line a client reads."""
        return {
            "event": "hello", "protocol": PROTOCOL, "version": __version__,
            "name": self._orders.loaded.file.name,
        }  # fmt: skip

    async def _hello(self, caller: Caller, take: RequestFields) -> Fields:
        protocol = int(take.number("protocol", PROTOCOL, 0, 1e6))
        caller.name = take.text("name", caller.name)
        take.end()
        if protocol != PROTOCOL:
            message = f"this daemon speaks protocol {PROTOCOL}, the client {protocol}; update the older one"
            raise RemoteError(Code.PROTOCOL, message)
        return {**self.hello(), "client": caller.number}

    async def _ping(self, caller: Caller, take: RequestFields) -> Fields:
        take.end()
        return {}

    async def _status(self, caller: Caller, take: RequestFields) -> Fields:
        take.end()
        now_s = time.monotonic()
        lateness = sorted(self._orders.lateness(LOOK_BACK))
        return {
            "name": self._orders.loaded.file.name,
            "file": str(self._orders.loaded.path),
            "version": __version__,
            "rate_hz": self._orders.rate_hz,
            "realtime": self._realtime,
            "uptime_s": round(now_s - self._began_s, 3),
            "clients": self._clients(),
            "waiting": self._orders.waiting or None,
            "right": self._right.as_fields(now_s),
            "trackers": self._trackers.as_fields(now_s),
            "lateness_us": {
                "p50": round(lateness[len(lateness) // 2] * 1e6, 1) if lateness else None,
                "max": round(lateness[-1] * 1e6, 1) if lateness else None,
            },
            **self._picture.status(self._orders.newest()),
        }

    async def _describe(self, caller: Caller, take: RequestFields) -> Fields:
        take.end()
        return {**self._picture.describe(), "rate_hz": self._orders.rate_hz, "fields": list(FIELDS)}

    async def _subscribe(self, caller: Caller, take: RequestFields) -> Fields:
        rate_hz = take.number("rate_hz", 20.0, 0.0, GREATEST_RATE_HZ)
        robots = self._picture.named(take) or tuple(self._picture.configs)
        fields = take.names("fields") or DEFAULT_FIELDS
        events = take.flag("events")
        take.end()
        unknown = [name for name in fields if name not in FIELDS]
        if unknown:
            message = f"no field {unknown[0]!r}; there are {', '.join(FIELDS)}"
            raise RemoteError(Code.BAD_REQUEST, message)
        caller.subscribe(rate_hz, robots, fields, events)
        return {"rate_hz": rate_hz, "robots": list(robots), "fields": list(fields), "events": events}

    async def _unsubscribe(self, caller: Caller, take: RequestFields) -> Fields:
        take.end()
        caller.unsubscribe()
        return {}
