"""The client for asyncio programs: requests of several tasks on one connection to a daemon.

A daemon obeys one client at a time, the one that holds the lease. Every request of that client renews it; a
client that is silent for longer than the time of its lease loses it, and the robots hold.
"""

from __future__ import annotations

import asyncio
import socket
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from contid.remote.client.client_protocol import Request
from contid.remote.client.procedures import Procedures
from contid.remote.protocol.connect import connect
from contid.remote.protocol.wire import ConnectionLostError, Fields, RemoteError
from contid_library.async_wires import AsyncQueuedWire, AsyncSocketWire

#: Period of attempts to connect while the backlog of the daemon is full.
CONNECT_PERIOD_S: Final = 0.005


class AsyncClient(Procedures):
    """A connection to a daemon; several tasks may use it. Open it with ``async with``.

    It has the requests and procedures of `Procedures`, and implements the six I/O operations that they await,
    the abstract methods of `contid.remote.client.orders.Orders`, from `_open` to `_disconnect`.

    Only requests and awaiting a move or telemetry keep the lease, never a background task: the lease of a
    program that hangs must lapse.
    """

    _lost: ConnectionLostError | RemoteError | None = None
    _wire: AsyncSocketWire | AsyncQueuedWire | None = None
    _reading: asyncio.Task[None] | None = None
    #: Requests that wait for their response, by number, and the event of a notice; `_open` makes both.
    _waiting: dict[int, tuple[Request, asyncio.Future[Fields]]]
    _noticed: asyncio.Event

    async def _open(self, path: Path) -> None:
        """Connect to a socket or an address, and begin to read."""
        self._waiting = {}
        self._noticed = asyncio.Event()
        if self._address is not None:
            self._wire = await AsyncQueuedWire.open(self._address)
        else:
            connected = await self._connected(path)
            self._wire = AsyncSocketWire(*await asyncio.open_unix_connection(sock=connected))
        self._reading = asyncio.create_task(self._read(self._wire))

    async def _connected(self, path: Path) -> socket.socket:
        """A connection; waits while the backlog is full (asyncio would take that for connected)."""
        deadline_s = time.monotonic() + self._protocol.timeout_s
        while True:
            try:
                return connect(path)
            except BlockingIOError:
                if time.monotonic() > deadline_s:
                    raise
            await asyncio.sleep(CONNECT_PERIOD_S)

    async def _exchange(self, request: Request) -> Fields:
        """Send a request and wait for its result, at most for its own time-out."""
        future: asyncio.Future[Fields] = asyncio.get_running_loop().create_future()
        self._waiting[request.number] = request, future
        try:
            async with asyncio.timeout(request.timeout_s):
                await self._post(request)
                return await future
        except TimeoutError:
            # An error with the daemon's reason, if it gave one; the connection itself is left as it is.
            raise self._protocol.lost(f"no response within {request.timeout_s:g} s") from None
        finally:
            self._waiting.pop(request.number, None)

    async def _post(self, request: Request) -> None:
        """Send a request without waiting; its result is looked up later."""
        if self._lost is not None or self._wire is None:
            raise self._lost or ConnectionLostError("not connected; use `async with`")
        await self._wire.send(request)

    async def _wait_notice(self, seconds: float) -> None:
        """Wait for a notice or the response to rows, at most for this time [s]."""
        if self._lost is not None:
            raise self._lost
        # What came before this call does not end the wait: callers have looked at it, or do so afterwards.
        self._noticed.clear()
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._noticed.wait()

    async def _sleep(self, seconds: float) -> None:
        """Wait for this time [s]; other tasks go on."""
        await asyncio.sleep(seconds)

    async def _read(self, wire: AsyncSocketWire | AsyncQueuedWire) -> None:
        """Take in lines and hand out results until the connection ends; a task of its own."""
        try:
            while chunk := await wire.receive():
                if self._protocol.receive(chunk):
                    self._noticed.set()
                for request, future in self._waiting.values():
                    self._resolve(request, future)
            lost: ConnectionLostError | RemoteError = self._protocol.lost("the daemon closed the connection")
        except RemoteError as error:
            lost = error
        except OSError as error:
            lost = self._protocol.lost(f"the connection ended ({error})")
        self._end(lost)

    def _end(self, lost: ConnectionLostError | RemoteError) -> None:
        """Fail every request that waits for its response, and wake the tasks that wait for a notice."""
        self._lost = self._lost or lost
        for _, future in self._waiting.values():
            if not future.done():
                future.set_exception(self._lost)
        self._noticed.set()

    def _resolve(self, request: Request, future: asyncio.Future[Fields]) -> None:
        """Set the response to a request, or the error of it, if it has come."""
        if future.done():
            return
        try:
            result = self._protocol.result(request)
        except RemoteError as error:
            future.set_exception(error)
        else:
            if result is not None:
                future.set_result(result)

    async def _disconnect(self) -> None:
        """Close the connection; tasks that still wait for a response get `ConnectionLostError`."""
        closed = ConnectionLostError("this client was closed")
        self._lost = self._lost or closed
        if self._reading is not None:
            self._reading.cancel()
            await asyncio.gather(self._reading, return_exceptions=True)
            self._end(closed)
        if self._wire is not None:
            await self._wire.close()

    async def __aenter__(self) -> Self:
        """Connect."""
        return await self.connect()

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close; after an error without releasing the lease, so that the robots hold."""
        if kind is None:
            await self.close()
        else:
            await self._disconnect()
