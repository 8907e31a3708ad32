"""One connection of the bridge to the socket of a daemon: requests, and lines as they are."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from contid.remote.client.client_protocol import CHUNK
from contid.remote.protocol import expiry
from contid.remote.protocol.connect import connect
from contid.remote.protocol.wire import (
    PROTOCOL,
    Code,
    ConnectionLostError,
    Fields,
    RemoteError,
    decode,
    encode,
)

CONNECT_TIMEOUT_S: Final = 1.0
CONNECT_PERIOD_S: Final = 0.005
#: How long a daemon may take to begin with a request [s]; shorter than an operator waits for its answer.
VALID_S: Final = 4.0
#: How telemetry begins; such a line is passed on without being parsed.
TELEMETRY: Final = b'{"event":"telemetry"'


class DaemonLink:
    """A connection. It sends what it is asked to send and nothing by itself: it keeps no lease.

    Args:
        path: path of the socket.
        noticed: called with each line that is no response, and with its fields (None for telemetry).
        ended: called once when the connection ends by itself.

    Attributes:
        hello: the daemon's first line.
        open: requests can be made.
    """

    def __init__(
        self, path: Path, noticed: Callable[[bytes, Fields | None], None], ended: Callable[[], None]
    ) -> None:
        self.hello: Fields = {}
        self.open = False
        self._path = path
        self._noticed = noticed
        self._ended = ended
        self._number = 0
        self._waiting: dict[int, asyncio.Future[Fields]] = {}
        self._writer: asyncio.StreamWriter | None = None
        self._reading: asyncio.Task[None] | None = None

    async def connect(self) -> None:
        """Connect and read the first line.

        Raises:
            OSError: nothing listens there.
            TimeoutError: no answer.
            ContidError: it is no daemon, or one of another user.
        """
        deadline_s = time.monotonic() + CONNECT_TIMEOUT_S
        while True:
            try:
                connected = connect(self._path)
                break
            except BlockingIOError:  # its backlog is full
                if time.monotonic() > deadline_s:
                    raise
            await asyncio.sleep(CONNECT_PERIOD_S)
        reader, self._writer = await asyncio.open_unix_connection(sock=connected, limit=CHUNK)
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT_S):
                self.hello = decode(await reader.readuntil(b"\n"))
        except (TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, RemoteError):
            self._writer.transport.abort()
            raise ConnectionLostError(f"{self._path}: the daemon does not answer") from None
        self.open = True
        self._reading = asyncio.create_task(self._read(reader))

    @property
    def same_protocol(self) -> bool:
        """The daemon has the protocol of this bridge."""
        return self.hello.get("protocol") == PROTOCOL

    async def request(self, verb: str, fields: Mapping[str, Any]) -> Fields:
        """The whole response to a request, refusals too, without its number; one without expiry gets one.

        Raises:
            ConnectionLostError: the connection ended.
        """
        if not self.open or self._writer is None:
            raise ConnectionLostError(f"{self._path}: not connected")
        self._number += 1
        number = self._number
        future: asyncio.Future[Fields] = asyncio.get_running_loop().create_future()
        self._waiting[number] = future
        try:
            until = {} if verb in expiry.LASTING else {expiry.FIELD: expiry.clock_s() + VALID_S}
            self._writer.write(encode({"id": number, "verb": verb, **until, **fields}))
            response = await future
        finally:
            self._waiting.pop(number, None)
        return {key: value for key, value in response.items() if key != "id"}

    async def result(self, verb: str, **fields: Any) -> Fields:
        """The result of a request.

        Raises:
            RemoteError: the daemon refused.
            ConnectionLostError: the connection ended.
        """
        response = await self.request(verb, fields)
        if not response.get("ok"):
            raise RemoteError.of(response.get("error", {}))
        result: Fields = response["result"]
        return result

    def close(self) -> None:
        """End the connection at once: robots that it moved hold."""
        self.open = False
        if self._reading is not None:
            self._reading.cancel()
        if self._writer is not None:
            self._writer.transport.abort()
        self._fail("the connection to the daemon was closed; robots that it moved hold")

    async def _read(self, reader: asyncio.StreamReader) -> None:
        """Take lines until the daemon closes the connection, or sends a line that cannot be read."""
        partial, reason = b"", "the daemon closed the connection; its robots hold"
        try:
            with suppress(OSError):
                while chunk := await reader.read(CHUNK):
                    *lines, partial = (partial + chunk).split(b"\n")
                    for line in lines:
                        self._take(line)
        except RemoteError as error:
            reason = f"a line of the daemon cannot be read: {error}; the connection was closed, robots hold"
        self.open = False
        if self._writer is not None:
            self._writer.transport.abort()
        self._fail(reason)
        self._ended()

    def _take(self, line: bytes) -> None:
        """Pass on a line that is no response, or answer the request that a response is for.

        Raises:
            RemoteError: it is no JSON object.
        """
        if line.startswith(TELEMETRY):
            self._noticed(line, None)
            return
        fields = decode(line)
        if "event" in fields:
            self._noticed(line, fields)
            return
        future = self._waiting.get(fields.get("id") or 0)
        if future is not None and not future.done():
            future.set_result(fields)

    def _fail(self, reason: str) -> None:
        """End the requests that wait for their responses."""
        for future in self._waiting.values():
            if not future.done():
                future.set_exception(ConnectionLostError(reason))


def refusal(code: Code | str, message: str) -> Fields:
    """A response that refuses."""
    return {"ok": False, "error": {"code": str(code), "message": message}}
