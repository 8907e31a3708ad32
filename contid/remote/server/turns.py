"""Turns of requests in the daemon's event loop: one starts at a time, and a flood leaves time for the rest.

A client that sends on without waiting for responses keeps the loop busy without a pause. On a computer with
two cores whatever else a stop passes through - a browser, the panel - then waits for the processor. Requests
behind which the same client's next one waits already take at most `SHARE` of the time, all clients together;
clients that wait for their responses are not delayed.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Final

#: Share of the loop's time for clients that do not wait for responses.
SHARE: Final = 0.2
#: Time that they may take at once [s]: a few hundred requests sent together are not delayed.
BURST_S: Final = 0.2
#: Least pause [s], so that a rounding error is not waited for.
LEAST_S: Final = 1e-3


class Turns:
    """The order in which requests of all connections start."""

    def __init__(
        self,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], Awaitable[object]] = asyncio.sleep,
    ) -> None:
        self._now = now
        self._sleep = sleep
        self._lock = asyncio.Lock()
        self._credit_s = BURST_S
        self._counted_s = now()

    @asynccontextmanager
    async def turn(self, more_wait: bool) -> AsyncIterator[None]:
        """Wait for a turn, which ends with the block; ``more_wait``: the client's next request is here."""
        if more_wait:
            while (missing_s := -self._credit()) > 0.0:
                await self._sleep(max(missing_s / SHARE, LEAST_S))
        async with self._lock:
            began_s = self._now()
            try:
                yield
            finally:
                if more_wait:
                    self._credit_s -= self._now() - began_s

    @property
    def delays(self) -> bool:
        """A client that does not wait for responses has to wait for its turn."""
        return self._credit() < 0.0

    def _credit(self) -> float:
        """The time that may be taken now [s]."""
        now_s = self._now()
        self._credit_s = min(self._credit_s + SHARE * (now_s - self._counted_s), BURST_S)
        self._counted_s = now_s
        return self._credit_s
