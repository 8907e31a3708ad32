"""The connection of one page to the daemon, with its own lease.

The daemon's client of a page sends what the page sends and nothing by itself: a page that is closed, hidden
or frozen sends no heartbeat, so its lease lapses and the robots hold.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Final

from contid.client import AsyncClient
from contid.remote.protocol.wire import ConnectionLostError, Fields, NoDaemonError
from contid_panel.expiry import ExpiringClient

#: How long an order to stop is repeated on connections that are lost, and the pause between two attempts.
PERSISTENCE_S: Final = 10.0
RETRY_S: Final = 0.05
#: Seconds without a heartbeat of the page after which its lease lapses.
LEASE_TIMEOUT_S: Final = 1.5


class PageGoneError(Exception):
    """Ends the connection without a release of the lease, so that the robots hold."""


class PageClient:
    """Requests of one page.

    Attributes:
        number: of the client at the daemon, 0 without a connection.
    """

    def __init__(self, path: Path, name: str) -> None:
        self.number = 0
        self._path = path
        self._name = name
        self._client: AsyncClient | None = None
        self._connecting = asyncio.Lock()

    async def client(self) -> AsyncClient:
        """The connection; a new one when the last one ended. It has no lease then.

        Raises:
            NoDaemonError: no daemon listens.
        """
        async with self._connecting:
            if self._client is None:
                self._client = await ExpiringClient(self._path, name=self._name).connect()
                self.number = int(self._client.hello.get("client", 0))  # none of another protocol
            return self._client

    async def request(self, send: Callable[[AsyncClient], Awaitable[Fields]]) -> Fields:
        """Make one request.

        Raises:
            ConnectionLostError: the connection ended; the next request makes a new one.
            NoDaemonError: no daemon listens.
            RemoteError: the daemon refused.
        """
        client = await self.client()
        try:
            return await send(client)
        except ConnectionLostError:
            await self._drop(client)
            raise

    async def stop(self, send: Callable[[AsyncClient], Awaitable[Fields]]) -> Fields:
        """Make a request to stop; it is repeated on a new connection when one is lost."""
        deadline_s = time.monotonic() + PERSISTENCE_S
        while True:
            try:
                return await self.request(send)
            except (ConnectionLostError, NoDaemonError):
                if time.monotonic() > deadline_s:
                    raise
            await asyncio.sleep(RETRY_S)

    async def abandon(self) -> None:
        """Disconnect without a release: if the page held the lease, the robots hold."""
        if self._client is not None:
            await self._drop(self._client)

    async def _drop(self, client: AsyncClient) -> None:
        if client is not self._client:
            return
        self._client, self.number = None, 0
        await client.__aexit__(PageGoneError, PageGoneError(), None)
