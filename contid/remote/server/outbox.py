"""Lines that wait to be written to one client, bounded in number.

Responses and notices keep their order; when too many wait, the outbox is marked as overflowed and its
connection is ended. Of telemetry only the newest frames are kept; dropped ones are counted.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Final

#: Responses and notices that may wait; more mean that the client does not read.
MAX_RESPONSES: Final = 256
#: Frames of telemetry that may wait.
MAX_FRAMES: Final = 32


class Outbox:
    """Lines for one client.

    Attributes:
        dropped: number of dropped frames of telemetry.
        overflowed: too many responses wait; one was dropped.
    """

    def __init__(self) -> None:
        self._responses: deque[bytes] = deque()
        self._frames: deque[bytes] = deque()
        self._ready = asyncio.Event()
        self.dropped = 0
        self.overflowed = False

    def put(self, line: bytes) -> None:
        """Add a response or a notice."""
        if len(self._responses) >= MAX_RESPONSES:
            self.overflowed = True
        else:
            self._responses.append(line)
        self._ready.set()

    def put_frame(self, line: bytes) -> None:
        """Add a frame of telemetry; without room the oldest one is dropped."""
        if len(self._frames) >= MAX_FRAMES:
            self._frames.popleft()
            self.dropped += 1
        self._frames.append(line)
        self._ready.set()

    async def get(self) -> bytes:
        """The next line, responses first; waits for one."""
        while not (self._responses or self._frames):
            self._ready.clear()
            await self._ready.wait()
        return self._responses.popleft() if self._responses else self._frames.popleft()
