"""One client connection: requests in, responses and telemetry out.

Requests start in their order; a long one does not delay the next, so a stop after a large trajectory is
carried out at once. Between two requests of one client the others get a turn.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from contid.lines import MAX_LINE
from contid.remote.protocol.wire import Code, RemoteError, decode, encode
from contid.remote.server.outbox import Outbox
from contid.remote.server.request_handler import RequestHandler

#: Requests of one client in progress; more wait in its socket.
MAX_PENDING: Final = 32
#: Lines that are no requests after which a client is disconnected.
MAX_BAD_REQUESTS: Final = 100
#: Seconds that a client may leave sent data unread.
STALL_S: Final = 5.0
#: Bytes that may wait in the kernel's and asyncio's buffers before writing pauses.
HIGH_WATER: Final = 1 << 16


@dataclass(slots=True)
class Subscription:
    """The telemetry that a client subscribed to.

    Attributes:
        rate_hz: frames per second, 0 for none.
        robots: names.
        fields: of `contid.remote.server.telemetry_view.FIELDS`.
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


class Connection:
    """A connected client (`contid.remote.server.query_handler.Caller`)."""

    def __init__(
        self,
        number: int,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        handler: RequestHandler,
    ) -> None:
        self.number = number
        self.name = f"client {number}"
        self.outbox = Outbox()
        self.subscription: Subscription | None = None
        self.active_s = asyncio.get_running_loop().time()
        self._reader = reader
        self._writer = writer
        self._handler = handler
        self._pending = asyncio.Semaphore(MAX_PENDING)
        self._requests: set[asyncio.Task[None]] = set()
        self._bad_requests = 0
        self._closing = asyncio.Event()

    async def run(self) -> None:
        """Serve the client until it leaves or is disconnected."""
        self._writer.transport.set_write_buffer_limits(high=HIGH_WATER)
        self.notify(self._handler.queries.hello())
        tasks = [asyncio.create_task(part()) for part in (self._read, self._write, self._closing.wait)]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (*tasks, *self._requests):
                task.cancel()
            await asyncio.gather(*tasks, *self._requests, return_exceptions=True)
            self._writer.transport.abort()

    def disconnect(self, message: str) -> None:
        """End the connection with a notice ``bye`` if the buffer takes it; waits for nothing."""
        if not self._closing.is_set():
            self._closing.set()
            with suppress(Exception):
                self._writer.write(encode({"event": "bye", "message": message}))

    def notify(self, fields: Mapping[str, Any]) -> None:
        """Send a response or a notice."""
        self.outbox.put(encode(fields))
        if self.outbox.overflowed:
            self.disconnect("responses are not read")

    def subscribe(self, rate_hz: float, robots: Sequence[str], fields: Sequence[str], events: bool) -> None:
        """Send telemetry from now on."""
        self.subscription = Subscription(rate_hz, tuple(robots), tuple(fields), events)

    def unsubscribe(self) -> None:
        """Send no more telemetry and events."""
        self.subscription = None

    # -- inside ------------------------------------------------------------------------------------------

    async def _read(self) -> None:
        while True:
            try:
                line = await self._reader.readuntil(b"\n")
            except asyncio.LimitOverrunError:
                self._refuse(None, RemoteError(Code.BAD_REQUEST, f"a line has at most {MAX_LINE} bytes"))
                await asyncio.sleep(0)  # lets the writer send the refusal
                return
            except (asyncio.IncompleteReadError, ConnectionError, OSError):
                return
            self.active_s = asyncio.get_running_loop().time()
            await self._pending.acquire()
            if self._closing.is_set():
                return
            task = asyncio.create_task(self._request(line))
            self._requests.add(task)
            task.add_done_callback(self._done)
            # The other clients' turn: one that floods does not get two requests in a row.
            await asyncio.sleep(0)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._requests.discard(task)
        self._pending.release()

    async def _request(self, line: bytes) -> None:
        number: Any = None
        try:
            fields = decode(line)
            number = fields.get("id")
            if not isinstance(number, int | str | None) or (isinstance(number, str) and len(number) > 200):
                number = None
                raise RemoteError(Code.BAD_REQUEST, "id: a whole number or a short text is expected")
            result = await self._handler.serve(self, fields)
        except RemoteError as error:
            self._refuse(number, error)
            self._bad_requests += error.code == Code.BAD_REQUEST
            if self._bad_requests >= MAX_BAD_REQUESTS:
                self.disconnect(f"{MAX_BAD_REQUESTS} lines were no requests")
        else:
            self.notify({"id": number, "ok": True, "result": result})

    def _refuse(self, number: Any, error: RemoteError) -> None:
        self.notify({"id": number, "ok": False, "error": error.as_fields()})

    async def _write(self) -> None:
        with suppress(ConnectionError, TimeoutError):
            while True:
                self._writer.write(await self.outbox.get())
                async with asyncio.timeout(STALL_S):
                    await self._writer.drain()
