"""One client: its requests in, its answers and telemetry out, and nothing that others would wait for.

Requests are begun in their order; one that takes long does not hold up the next, so that a stop after a large
trajectory is not kept waiting. Between two requests of a client everybody else gets a turn.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from contid.remote.protocol.wire import MAX_LINE, Code, RemoteError, decode, encode
from contid.remote.server.outbox import Outbox
from contid.remote.server.request_handler import RequestHandler

#: Requests of one client under way; more wait in its socket.
MAX_PENDING: Final = 32
#: Lines that are no requests after which a client is sent away.
MAX_GARBAGE: Final = 100
#: Seconds that a client may leave what was sent to it unread.
STALL_S: Final = 5.0
#: Bytes that may wait in the kernel's and asyncio's buffers before writing pauses.
HIGH_WATER: Final = 1 << 16


@dataclass(slots=True)
class Subscription:
    """What a client wants to hear.

    Attributes:
        rate_hz: frames per second, 0 for none.
        robots: which.
        fields: of `contid.remote.server.telemetry_view.FIELDS`.
        events: states, faults and refusals as they happen.
        next_s: when the next frame is due.
        tick: of the last frame.
    """

    rate_hz: float
    robots: tuple[str, ...]
    fields: tuple[str, ...]
    events: bool
    next_s: float = 0.0
    tick: int = -1


class Connection:
    """A client that is connected."""

    def __init__(
        self, number: int, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, verbs: RequestHandler
    ) -> None:
        self.number = number
        self.name = f"client {number}"
        self.outbox = Outbox()
        self.subscription: Subscription | None = None
        self.active_s = asyncio.get_running_loop().time()
        self._reader = reader
        self._writer = writer
        self._verbs = verbs
        self._pending = asyncio.Semaphore(MAX_PENDING)
        self._requests: set[asyncio.Task[None]] = set()
        self._garbage = 0
        self._leaving = asyncio.Event()

    async def run(self) -> None:
        """Serve it until it leaves or is sent away."""
        self._writer.transport.set_write_buffer_limits(high=HIGH_WATER)
        self.tell(self._verbs.reading.hello())
        tasks = [asyncio.create_task(part()) for part in (self._read, self._write, self._leaving.wait)]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (*tasks, *self._requests):
                task.cancel()
            await asyncio.gather(*tasks, *self._requests, return_exceptions=True)
            self._writer.transport.abort()

    def send_away(self, message: str) -> None:
        """End the connection; tries to say why, and waits for nobody."""
        if not self._leaving.is_set():
            self._leaving.set()
            with suppress(Exception):
                self._writer.write(encode({"event": "bye", "message": message}))

    # -- what the verbs need -----------------------------------------------------------------------------

    def tell(self, fields: Mapping[str, Any]) -> None:
        """An answer or a notice."""
        self.outbox.answer(encode(fields))
        if self.outbox.overflowed:
            self.send_away("answers are not read")

    def subscribe(self, rate_hz: float, robots: Sequence[str], fields: Sequence[str], events: bool) -> None:
        """See `contid.remote.server.query_handler.Caller`."""
        self.subscription = Subscription(rate_hz, tuple(robots), tuple(fields), events)

    def unsubscribe(self) -> None:
        """See `contid.remote.server.query_handler.Caller`."""
        self.subscription = None

    # -- the two directions --------------------------------------------------------------------------------

    async def _read(self) -> None:
        while True:
            try:
                line = await self._reader.readuntil(b"\n")
            except asyncio.LimitOverrunError:
                self._refuse(None, RemoteError(Code.BAD_REQUEST, f"a line has at most {MAX_LINE} bytes"))
                await asyncio.sleep(0)  # the writer's turn, to say so
                return
            except (asyncio.IncompleteReadError, ConnectionError, OSError):
                return
            self.active_s = asyncio.get_running_loop().time()
            await self._pending.acquire()
            if self._leaving.is_set():
                return
            task = asyncio.create_task(self._request(line))
            self._requests.add(task)
            task.add_done_callback(self._answered)
            # Everybody else's turn: a client that floods does not get two requests in a row.
            await asyncio.sleep(0)

    def _answered(self, task: asyncio.Task[None]) -> None:
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
            result = await self._verbs.serve(self, fields)
        except RemoteError as error:
            self._refuse(number, error)
            self._garbage += error.code == Code.BAD_REQUEST
            if self._garbage >= MAX_GARBAGE:
                self.send_away(f"{MAX_GARBAGE} lines were no requests")
        else:
            self.tell({"id": number, "ok": True, "result": result})

    def _refuse(self, number: Any, error: RemoteError) -> None:
        self.tell({"id": number, "ok": False, "error": error.as_fields()})

    async def _write(self) -> None:
        with suppress(ConnectionError, TimeoutError):
            while True:
                self._writer.write(await self.outbox.take())
                # At once while there is room; a client that reads nothing is not waited for long.
                async with asyncio.timeout(STALL_S):
                    await self._writer.drain()
