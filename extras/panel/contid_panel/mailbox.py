"""Messages that wait to be sent to a page: the newest frame only, and a bounded number of other messages."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Final

#: Messages other than frames that may wait; a page that does not read them is closed.
MAX_WAITING: Final = 256


class Mailbox:
    """Messages for one page.

    Attributes:
        overflown: more waits than a page may leave unread.
    """

    def __init__(self) -> None:
        self.overflown = False
        self._frame: str | None = None
        self._waiting: deque[str] = deque()
        self._ready = asyncio.Event()

    def put_frame(self, text: str) -> None:
        """Replace the frame that waits."""
        self._frame = text
        self._ready.set()

    def put(self, text: str) -> None:
        """Add a message."""
        if len(self._waiting) >= MAX_WAITING:
            self.overflown = True
        else:
            self._waiting.append(text)
        self._ready.set()

    async def take(self) -> str | None:
        """The next message, frames last; None when the page has left too many unread."""
        while True:
            if self.overflown:
                return None
            if self._waiting:
                return self._waiting.popleft()
            if self._frame is not None:
                text, self._frame = self._frame, None
                return text
            self._ready.clear()
            await self._ready.wait()
