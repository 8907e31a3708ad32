"""The wires of `contid.remote.client.wires` for asyncio."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Any

from contid.remote.client.client_protocol import CHUNK, Request
from contid.remote.client.wires import Address


class AsyncSocketWire:
    """The Unix socket of a daemon, for asyncio."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    async def send(self, request: Request) -> None:
        """Send a request."""
        self._writer.write(request.line)
        with suppress(ConnectionError):
            await self._writer.drain()

    async def receive(self) -> bytes:
        """The next bytes, b"" after the end."""
        return await self._reader.read(CHUNK)

    async def close(self) -> None:
        """End the connection."""
        self._writer.close()
        with suppress(OSError):
            await self._writer.wait_closed()


class AsyncQueuedWire:
    """The wire of an address, for asyncio. Use `open`."""

    def __init__(self) -> None:
        self._lines: asyncio.Queue[bytes] = asyncio.Queue()
        self._wire: Any = None

    @classmethod
    async def open(cls, address: Address) -> AsyncQueuedWire:
        """Connect, in a thread: it may take a second."""
        loop, opened = asyncio.get_running_loop(), cls()

        def deliver(line: bytes) -> None:
            with suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(opened._lines.put_nowait, line)

        opened._wire = await asyncio.to_thread(address.open, deliver)
        return opened

    async def send(self, request: Request) -> None:
        """Send a request, in a thread: it may wait for room."""
        await asyncio.to_thread(self._wire.send, request)

    async def receive(self) -> bytes:
        """The next line, b"" after the end."""
        return await self._lines.get()

    async def close(self) -> None:
        """End the connection."""
        await asyncio.to_thread(self._wire.close)
