"""Bounds of the panel's server: connections, and the time for a request to come."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from typing import ClassVar, Final

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from contid_panel.access import Access, AccessError, bearer

#: Pages at a time; each is a client of the daemon, which takes 96.
MAX_PAGES: Final = 12
#: Connections at a time that have not shown the token. A browser opens six per page for the static files.
MAX_CONNECTIONS: Final = 96
#: Seconds for the header of every request, and for a response to be read by a client without the token.
HEADER_TIMEOUT_S: Final = 5.0
RESPONSE_TIMEOUT_S: Final = 10.0
#: Bytes of one message of a page, of one request's header, and of an uploaded trajectory.
MAX_MESSAGE: Final = 1 << 16
MAX_HEADER: Final = 1 << 14
MAX_UPLOAD: Final = 8 << 20
#: Seconds for an uploaded trajectory to come; there is one upload at a time.
UPLOAD_TIMEOUT_S: Final = 20.0
#: Messages per second of one page, and how many may come at once.
MESSAGE_RATE_HZ: Final = 120.0
MESSAGE_BURST: Final = 240.0


class PanelHttp(H11Protocol):
    """HTTP of the panel: a deadline for every request, and a reserve for clients that have the token.

    Beyond the bound the connection without the token that has waited longest gives way to a new one: who has
    the token shows it in the first request, and is then out of reach of those who do not.
    """

    access: ClassVar[Access]
    _known = False
    _deadline: asyncio.TimerHandle | None = None

    # uvicorn declares the type that every loop gives it, narrower than asyncio's own.
    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection; one without the token may give way to it."""
        super().connection_made(transport)
        self._expect(HEADER_TIMEOUT_S)
        unknown = [each for each in self.connections if isinstance(each, PanelHttp) and not each._known]
        if len(unknown) > MAX_CONNECTIONS:
            min(unknown, key=lambda each: each._since_s)._abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """See `asyncio.Protocol`."""
        self._expect(None)
        super().connection_lost(exc)

    def handle_events(self) -> None:
        """Begin the requests that have come."""
        before = self.cycle
        super().handle_events()
        if self.cycle is before or self.cycle.response_complete:
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in self.headers}
        with suppress(AccessError):
            self.access.check_token(bearer(headers))
            self._known = True
        # The application has its own bounds for who has the token: an upload, a check, a stop.
        self._expect(None if self._known else RESPONSE_TIMEOUT_S)

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Leave the connection to the WebSocket, which checks the token."""
        self._expect(None)
        super().handle_websocket_upgrade(event)

    def on_response_complete(self) -> None:
        """Wait for the next request, as long as for the first one."""
        self._expect(HEADER_TIMEOUT_S)
        super().on_response_complete()

    def _expect(self, seconds: float | None) -> None:
        """Close the connection after this time unless something else is expected before; None: never."""
        if self._deadline is not None:
            self._deadline.cancel()
        self._since_s = self.loop.time()
        self._deadline = None if seconds is None else self.loop.call_later(seconds, self._abort)

    def _abort(self) -> None:
        self.connections.discard(self)  # at once: the next connection must not choose it again
        self.transport.abort()


def panel_http(access: Access) -> type[PanelHttp]:
    """The protocol of a panel with this token."""
    return type("PanelHttp", (PanelHttp,), {"access": access})


class MessageRate:
    """A token bucket for the messages of one page."""

    def __init__(self) -> None:
        self._tokens = MESSAGE_BURST
        self._at_s = time.monotonic()

    def spend(self) -> bool:
        """Take one message; False when there are too many."""
        now_s = time.monotonic()
        self._tokens = min(self._tokens + (now_s - self._at_s) * MESSAGE_RATE_HZ, MESSAGE_BURST)
        self._at_s = now_s
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True
