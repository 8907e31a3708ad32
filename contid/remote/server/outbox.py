"""What waits to be written to one client: bounded, so that a client that never reads costs nothing.

Answers and notices keep their order and are never dropped: a client that lets too many of them pile up is
sent away. Telemetry keeps only its newest frames; the older ones are dropped and counted.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Final

#: Answers and notices that may wait; more means that the client does not read.
MAX_ANSWERS: Final = 256
#: Frames of telemetry that may wait.
MAX_FRAMES: Final = 32


class Outbox:
    """Lines for one client.

    Attributes:
        dropped: frames of telemetry that were dropped.
        overflowed: more answers waited than are allowed.
    """

    def __init__(self) -> None:
        self._answers: deque[bytes] = deque()
        self._frames: deque[bytes] = deque()
        self._ready = asyncio.Event()
        self.dropped = 0
        self.overflowed = False

    def answer(self, line: bytes) -> None:
        """An answer or a notice."""
        if len(self._answers) >= MAX_ANSWERS:
            self.overflowed = True
        else:
            self._answers.append(line)
        self._ready.set()

    def frame(self, line: bytes) -> None:
        """A frame of telemetry; the oldest one goes when there is no room."""
        if len(self._frames) >= MAX_FRAMES:
            self._frames.popleft()
            self.dropped += 1
        self._frames.append(line)
        self._ready.set()

    async def take(self) -> bytes:
        """The next line, answers first; waits for one."""
        while not (self._answers or self._frames):
            self._ready.clear()
            await self._ready.wait()
        return self._answers.popleft() if self._answers else self._frames.popleft()

    @property
    def empty(self) -> bool:
        """True when nothing waits."""
        return not (self._answers or self._frames)
