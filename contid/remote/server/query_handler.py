"""The verbs that change nothing: hello, ping, status, describe, telemetry. Every client may use them."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol, TypeAlias

from contid import __version__
from contid.control.daemon.interfaces import RunControl, RunRecordings
from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import TELEMETRY_HZ, ControlStalled, OverloadChanged, TicksSkipped
from contid.control.engine.events.robots import PathSlowed
from contid.control.engine.events.run import LogWritten, RunStarted, StreamDelayed
from contid.remote.protocol.peer_credentials import ClientRole
from contid.remote.protocol.wire import PROTOCOL, Code, Fields, RemoteError, RequestFields
from contid.remote.server.lateness_histogram import LatenessHistogram
from contid.remote.server.lease import Lease
from contid.remote.server.robot_fields import DEFAULT_FIELDS, FIELDS
from contid.remote.server.telemetry_view import TelemetryView
from contid.remote.server.trackers import Trackers

#: Newest ticks that the lateness in ``status`` covers.
LATENESS_TICKS: Final = 200
#: Logger of the warnings about skipped ticks.
SKIPPED: Final = "contid.pace"
#: Newest warnings and errors in ``status``.
WARNINGS: Final = 20
#: Frames per second that one client can get.
MAX_RATE_HZ: Final = 200.0


@dataclass(slots=True)
class Subscription:
    """The telemetry that a client subscribed to.

    Attributes:
        rate_hz: frames per second, 0 for none.
        robots: names.
        fields: of `contid.remote.server.robot_fields.FIELDS`.
        events: send states, faults and refusals as they happen.
        next_s: due time of the next frame.
        tick: of the last frame.
    """

    rate_hz: float
    robots: tuple[str, ...]
    fields: tuple[str, ...]
    events: bool
    next_s: float = 0.0
    tick: int = -1

    def due(self, at_s: float, tick_s: float) -> bool:
        """True when a record of this time is sent: from half a tick early, so that each tick can be had."""
        return self.rate_hz > 0.0 and at_s >= self.next_s - 0.5 * tick_s

    def sent(self, now_s: float, tick: int, most_hz: float = math.inf) -> None:
        """Note a frame; the next one is due a period after this one was, a late one makes no burst."""
        period_s = 1.0 / min(self.rate_hz, most_hz)
        self.next_s = (self.next_s if now_s - self.next_s < period_s else now_s) + period_s
        self.tick = tick


class Caller(Protocol):
    """The client that sent a request; see `contid.remote.server.connection.Connection`."""

    number: int
    name: str
    by: str
    role: ClientRole
    subscription: Subscription | None

    def notify(self, fields: Mapping[str, Any]) -> None:
        """Send a notice."""
        ...


#: Carries out one verb for a client: the fields of the request to the result of the response.
Verb: TypeAlias = Callable[[Caller, RequestFields], Awaitable[Fields]]


class QueryHandler:
    """The verbs that change nothing.

    Attributes:
        verbs: by name.
    """

    def __init__(
        self,
        control: RunControl,
        view: TelemetryView,
        lease: Lease,
        trackers: Trackers,
        clients: Callable[[], int],
        lateness: LatenessHistogram,
        recordings: RunRecordings | None,
    ) -> None:
        """Read from all of these; ``clients`` counts the connected clients."""
        self._lateness = lateness
        self._control = control
        self._view = view
        self._lease = lease
        self._trackers = trackers
        self._clients = clients
        self._recordings = recordings
        self._began_s = time.monotonic()
        self._realtime: bool | None = None
        self._stalled = False
        self._skips = ""
        self._stream_delay_ms: float | None = None
        self._overload: OverloadChanged | None = None
        self._warnings: deque[Fields] = deque(maxlen=WARNINGS)
        self.verbs: dict[str, Verb] = {
            "hello": self._hello, "ping": self._ping, "status": self._status, "describe": self._describe,
            "subscribe": self._subscribe, "unsubscribe": self._unsubscribe,
        }  # fmt: skip

    def notice(self, event: RunEvent) -> None:
        """Take in an event of the ring."""
        if isinstance(event, RunStarted):
            self._realtime = event.realtime
        elif isinstance(event, ControlStalled):
            self._stalled = not event.over
        elif isinstance(event, StreamDelayed):
            self._stream_delay_ms = event.delay_ms
        elif isinstance(event, OverloadChanged):
            self._overload = event if event.level else None
            self._warn("warning", SKIPPED, str(event))
        elif isinstance(event, LogWritten) and event.level not in ("debug", "info"):
            self._warn(event.level, event.logger, event.message)
        elif isinstance(event, PathSlowed):
            self._warn("warning", event.robot, event.message)
        elif isinstance(event, TicksSkipped):
            if self._warnings and self._warnings[-1]["message"] == self._skips:
                self._warnings.pop()  # the total is in the new one
            self._skips = str(event)
            self._warn("warning", SKIPPED, self._skips)

    @property
    def telemetry_hz(self) -> float:
        """Most frames per second that a client gets now."""
        return TELEMETRY_HZ if self._overload else math.inf

    def _warn(self, level: str, logger: str, message: str) -> None:
        at_s = round(time.monotonic() - self._began_s, 3)
        self._warnings.append({"at_s": at_s, "level": level, "logger": logger, "message": message})

    def hello(self) -> Fields:
        """The first line of the server."""
        name = self._control.loaded.file.name
        return {"event": "hello", "protocol": PROTOCOL, "version": __version__, "name": name}

    async def _hello(self, caller: Caller, request: RequestFields) -> Fields:
        protocol = int(request.number("protocol", PROTOCOL, 0, 1e6))
        caller.name = _printable(request.text("name", caller.name))
        caller.by = _printable(request.text("by", caller.by))
        request.end()
        if protocol != PROTOCOL:
            older = "client" if protocol < PROTOCOL else "daemon"
            message = f"protocol {protocol} is not supported; this daemon has {PROTOCOL}: update the {older}"
            raise RemoteError(Code.PROTOCOL, message)
        return {**self.hello(), "client": caller.number, "role": caller.role.value}

    async def _ping(self, caller: Caller, request: RequestFields) -> Fields:
        request.end()
        return {}

    async def _status(self, caller: Caller, request: RequestFields) -> Fields:
        request.end()
        record = self._control.newest()
        await self._view.answers.ask(record, self._view.configs, ("tip_mm",))
        now_s = time.monotonic()
        lateness = sorted(self._control.lateness(LATENESS_TICKS))
        return {
            "name": self._control.loaded.file.name,
            "file": str(self._control.loaded.path.absolute()),
            "version": __version__,
            "rate_hz": self._control.rate_hz,
            "realtime": self._realtime,
            "stalled": self._stalled,
            "stream_delay_ms": self._stream_delay_ms,
            "overload": None
            if self._overload is None
            else {
                "rate_hz": self._overload.rate_hz,
                "telemetry_hz": TELEMETRY_HZ,
                "message": str(self._overload),
            },
            "uptime_s": round(now_s - self._began_s, 3),
            "clients": self._clients(),
            "waiting": self._control.waiting or None,
            "warnings": list(self._warnings),
            "lease": self._lease.as_fields(now_s),
            "recordings": [] if self._recordings is None else self._recordings.as_fields(),
            "trackers": self._trackers.as_fields(now_s),
            "lateness_us": {
                "p50": round(lateness[len(lateness) // 2] * 1e6, 1) if lateness else None,
                "max": round(lateness[-1] * 1e6, 1) if lateness else None,
            },
            "lateness_classes": self._lateness.as_fields(),
            **self._view.status(record, now_s, self._control.costs()),
        }

    async def _describe(self, caller: Caller, request: RequestFields) -> Fields:
        request.end()
        return {**self._view.describe(), "rate_hz": self._control.rate_hz, "fields": list(FIELDS)}

    async def _subscribe(self, caller: Caller, request: RequestFields) -> Fields:
        rate_hz = request.number("rate_hz", 20.0, 0.0, MAX_RATE_HZ)
        robots = self._view.named(request) or tuple(self._view.configs)
        fields = tuple(dict.fromkeys(request.names("fields") or DEFAULT_FIELDS))
        events = request.flag("events")
        request.end()
        unknown = [name for name in fields if name not in FIELDS]
        if unknown:
            message = f"no field {unknown[0]!r}; there are {', '.join(FIELDS)}"
            raise RemoteError(Code.BAD_REQUEST, message)
        caller.subscription = Subscription(rate_hz, robots, fields, events)
        return {"rate_hz": rate_hz, "robots": list(robots), "fields": list(fields), "events": events}

    async def _unsubscribe(self, caller: Caller, request: RequestFields) -> Fields:
        request.end()
        caller.subscription = None
        return {}


def _printable(text: str) -> str:
    """For messages on terminals: no escape sequences, no marks that turn the direction of writing."""
    return "".join(character if character.isprintable() else "?" for character in text)
