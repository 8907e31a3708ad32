"""Bounds of the panel's server: connections, and the time for a request to come."""

from __future__ import annotations

import asyncio
import time
from typing import Final

from uvicorn.protocols.http.h11_impl import H11Protocol

#: Pages at a time; each is a client of the daemon, which takes 96.
MAX_PAGES: Final = 12
#: Connections at a time. A browser opens six per page for the static files.
MAX_CONNECTIONS: Final = 96
#: Seconds for the header of a first request.
HEADER_TIMEOUT_S: Final = 5.0
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
    """HTTP of the panel: connections beyond the bound, and those that send no request, are closed."""

    # uvicorn declares the type that every loop gives it, narrower than asyncio's own.
    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection, or close it."""
        super().connection_made(transport)
        if len(self.connections) > MAX_CONNECTIONS:
            transport.abort()
            return
        self.loop.call_later(HEADER_TIMEOUT_S, self._close_silent)

    def _close_silent(self) -> None:
        # A connection that became a WebSocket has left the set; `cycle` is that of the first request.
        if self in self.connections and getattr(self, "cycle", None) is None:
            self.transport.abort()


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
