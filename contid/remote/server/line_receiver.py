"""The lines that one client sends, divided as they arrive.

They are passed on inside the callback of the event loop that read them, ahead of every task, to be looked
through for stops; then they wait in their order. So the lines of other clients delay no stop.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

from contid.units import MAX_LINE

#: Bytes of lines that wait to be served; with more, the client's data stay in its socket.
MAX_WAITING: Final = 1 << 14
#: One turn of the event loop reads one client at a time, and copies what it read.
_BUFFER: Final = memoryview(bytearray(MAX_LINE))


class LineReceiver(asyncio.BufferedProtocol):
    """Receives one client.

    Attributes:
        transport: to the client; None before the connection is made.
        lines: complete ones that nothing has taken yet, in their order.
        partial: the begin of a line.
        taken: number of lines that were taken.
        active_s: when the client sent something, or connected.
        active: it has sent something.
        lost: the connection is closed, nothing can be sent.
    """

    def __init__(self, on_lines: Callable[[Sequence[bytes]], None]) -> None:
        """Receive; ``on_lines`` gets the lines that were read at once."""
        self.transport: asyncio.Transport | None = None
        self.lines: deque[bytes] = deque()
        self.partial = b""
        self.active_s = asyncio.get_running_loop().time()
        self.active = False
        self.lost = False
        self.taken = 0
        self._on_lines = on_lines
        self._waiting = 0
        self._paused = self._ended = False
        self._changed = asyncio.Event()
        self._writable = asyncio.Event()
        self._writable.set()

    async def line(self) -> bytes | None:
        """The next line; None at the end, and when a line is longer than `MAX_LINE`."""
        while not self.lines:
            if self._ended or self.too_long:
                return None
            self._changed.clear()
            await self._changed.wait()
        self.taken += 1
        return self.remove(0)

    def remove(self, place: int) -> bytes:
        """Take the line at a place out of those that wait."""
        line = self.lines[place]
        del self.lines[place]
        self._waiting -= len(line)
        if self._paused and self._waiting <= MAX_WAITING and self.transport is not None:
            self._paused = False
            self.transport.resume_reading()
        return line

    @property
    def too_long(self) -> bool:
        """A line is longer than `MAX_LINE`."""
        return len(self.partial) > MAX_LINE

    async def writable(self, timeout_s: float) -> None:
        """Wait while the client leaves too much unread.

        Raises:
            TimeoutError: for longer than ``timeout_s``.
        """
        if not self._writable.is_set():
            async with asyncio.timeout(timeout_s):
                await self._writable.wait()

    def feed(self, data: bytes) -> None:
        """Divide received bytes into lines."""
        *complete, self.partial = (self.partial + data).split(b"\n")
        if not complete:
            return
        self.lines.extend(complete)
        self._waiting += sum(map(len, complete))
        self._on_lines(complete)

    def clear(self) -> None:
        """Forget what came."""
        self.lines.clear()
        self.partial = b""
        self._waiting = 0

    # -- asyncio.BufferedProtocol ------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See `asyncio.BaseProtocol`."""
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def get_buffer(self, sizehint: int) -> memoryview:
        """See `asyncio.BufferedProtocol`; its content is copied before the next client is read."""
        return _BUFFER

    def buffer_updated(self, nbytes: int) -> None:
        """See `asyncio.BufferedProtocol`."""
        self.active_s, self.active = asyncio.get_running_loop().time(), True
        self.feed(bytes(_BUFFER[:nbytes]))
        if (self._waiting > MAX_WAITING or self.too_long) and self.transport is not None:
            self._paused = True
            self.transport.pause_reading()
        self._changed.set()

    def eof_received(self) -> bool:
        """See `asyncio.BufferedProtocol`; the connection stays open for the last responses."""
        self._ended = True
        self._changed.set()
        return True

    def pause_writing(self) -> None:
        """See `asyncio.BaseProtocol`."""
        self._writable.clear()

    def resume_writing(self) -> None:
        """See `asyncio.BaseProtocol`."""
        self._writable.set()

    def connection_lost(self, exc: Exception | None) -> None:
        """See `asyncio.BaseProtocol`."""
        self._ended = self.lost = True
        self._changed.set()
        self._writable.set()
