"""One client connection: requests in, responses and telemetry out.

Requests start in their order (`contid.remote.server.turns`); a long one does not delay the next, so
a stop after a large trajectory is carried out at once. An emergency stop is recognised before its line is
parsed (`contid.remote.protocol.wire`) and obeyed when it arrives (`contid.remote.server.line_receiver`).
"""

from __future__ import annotations

import asyncio
import logging
import os
import socket
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, Final

from contid.remote.protocol.peer_credentials import ClientRole
from contid.remote.protocol.wire import ESTOP, Code, Fields, RemoteError, decode, encode, is_estop
from contid.remote.server.line_receiver import LineReceiver
from contid.remote.server.outbox import Outbox
from contid.remote.server.query_handler import Subscription
from contid.remote.server.request_handler import RequestHandler
from contid.remote.server.turns import RequestStarter, Turns, check_not_overtaken
from contid.units import MAX_LINE

#: Lines that are no requests after which a client is disconnected.
MAX_BAD_REQUESTS: Final = 100
#: Seconds that a client may leave sent data unread.
STALL_S: Final = 5.0
#: Bytes that may wait in the kernel's and asyncio's buffers before writing pauses.
HIGH_WATER: Final = 1 << 16

log = logging.getLogger(__name__)


class Connection:
    """A connected client (`contid.remote.server.query_handler.Caller`).

    Attributes:
        number, name: of the client.
        by: the person or program that the client speaks for, as it gave it; "" for itself.
        role: what it may do.
        outbox: lines to send.
        subscription: None without one.
        receiver: of its lines; the protocol of the transport.
    """

    def __init__(
        self,
        number: int,
        handler: RequestHandler,
        turns: Turns,
        role: ClientRole = ClientRole.ALL,
    ) -> None:
        """Serve a client; ``turns`` are those of all connections."""
        self.number = number
        self.name = f"client {number}"
        self.by = ""
        self.role = role
        self.outbox = Outbox()
        self.subscription: Subscription | None = None
        # An emergency stop is obeyed before its turn; its request follows in its order and gets the response.
        self.receiver = LineReceiver(self._arrived)
        self._handler = handler
        self._starter = RequestStarter(self.receiver, turns, self._request)
        self._bad_requests = 0
        self._closing = asyncio.Event()

    async def run(self) -> None:
        """Serve the client of the receiver's transport until it leaves or is disconnected."""
        self._transport.set_write_buffer_limits(high=HIGH_WATER)
        self.notify(self._handler.queries.hello())
        tasks = [asyncio.create_task(part()) for part in (self._read, self._write, self._closing.wait)]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (*tasks, *self._starter.requests):
                task.cancel()
            await asyncio.gather(*tasks, *self._starter.requests, return_exceptions=True)
            self._take_rest()
            self._obey_rest()
            self._transport.abort()

    def disconnect(self, message: str) -> None:
        """End the connection with a notice ``bye`` if the buffer takes it; waits for nothing."""
        if not self._closing.is_set():
            self._closing.set()
            with suppress(Exception):
                self._write_line(encode({"event": "bye", "message": message}))

    def notify(self, fields: Mapping[str, Any]) -> None:
        """Send a response or a notice."""
        self.outbox.put(encode(fields))
        if self.outbox.overflowed:
            self.disconnect("responses are not read")

    # -- inside ------------------------------------------------------------------------------------------

    @property
    def _transport(self) -> asyncio.Transport:
        assert self.receiver.transport is not None
        return self.receiver.transport

    async def _read(self) -> None:
        while (line := await self.receiver.line()) is not None:
            await self._starter.start(line)
        if self.receiver.too_long:
            self._refuse(None, RemoteError(Code.BAD_REQUEST, f"a line has at most {MAX_LINE} bytes"))
            await asyncio.sleep(0)  # lets the writer send the refusal

    def _obey_rest(self) -> None:
        """Obey an emergency stop among what a client sent before it disconnected, or was disconnected."""
        if any(map(is_estop, (*self.receiver.lines, self.receiver.partial))):
            self._handler.stops.estop_all(self)
        self.receiver.clear()

    def _take_rest(self) -> None:
        """Read what the kernel still holds, before the transport closes the socket."""
        connected = self._transport.get_extra_info("socket")
        descriptor = connected.fileno()
        with suppress(OSError):
            connected.shutdown(socket.SHUT_RD)  # a client that goes on sending would never be read to its end
            while descriptor >= 0 and not self.receiver.too_long and (chunk := os.read(descriptor, MAX_LINE)):
                self.receiver.feed(chunk)

    def _arrived(self, lines: Sequence[bytes]) -> None:
        """Obey the first emergency stop of lines that were read at once."""
        if estop := next(filter(is_estop, lines), None):
            self._handler.stops.estop_before_turn(self, estop)
        self._starter.overtake()

    async def _request(self, line: bytes, overtaken: bool) -> None:
        number: Any = None
        try:
            try:
                fields = decode(line)
                number = _number(fields)
                if fields.get("verb") != ESTOP and is_estop(line):
                    raise RemoteError(Code.BAD_REQUEST, f"the verb is {ESTOP!r}, written once")
            except RemoteError as error:
                raise (
                    await self._handler.stops.obey_malformed_estop(self, error) if is_estop(line) else error
                ) from None
            if overtaken:
                check_not_overtaken(fields.get("verb"))
            self.notify({"id": number, "ok": True, "result": await self._handler.serve(self, fields)})
        except RemoteError as error:
            self._refuse(number, error)
            self._bad_requests += error.code == Code.BAD_REQUEST
            if self._bad_requests >= MAX_BAD_REQUESTS:
                self.disconnect(f"{MAX_BAD_REQUESTS} lines were no requests")
        except Exception as error:
            # The client waits for a response, whatever failed.
            log.exception("a request of %s failed", self.name)
            message = f"the daemon failed to carry this out ({type(error).__name__}: {error}); see its log"
            self._refuse(number, RemoteError(Code.INTERNAL, message))

    def _refuse(self, number: Any, error: RemoteError) -> None:
        self.notify({"id": number, "ok": False, "error": error.as_fields()})

    def _write_line(self, line: bytes) -> None:
        self._transport.write(line)
        if self._transport.is_closing():  # the peer does not read any more
            self._take_rest()

    async def _write(self) -> None:
        with suppress(TimeoutError):
            while not self.receiver.lost:
                self._write_line(await self.outbox.get())
                await self.receiver.writable(STALL_S)


def _number(fields: Fields) -> int | str | None:
    """The ``id`` of a request.

    Raises:
        RemoteError: neither a whole number nor a short text.
    """
    number = fields.get("id")
    if not isinstance(number, int | str | None) or (isinstance(number, str) and len(number) > 200):
        raise RemoteError(Code.BAD_REQUEST, "id: a whole number or a short text is expected")
    return number
