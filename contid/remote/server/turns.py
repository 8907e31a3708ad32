"""When requests start: one at a time in the daemon's event loop, those of a client in their order.

A client that sends on without waiting for responses keeps the loop busy without a pause. On a computer with
two cores whatever else a stop passes through - a browser, the panel - then waits for the processor. Requests
behind which the same client's next one waits already take at most `SHARE` of the time, all clients together;
clients that wait for their responses are not delayed.

Orders to stop and other short requests of `PROMPT` wait for no turn. A request that waits for an end of
those in progress (`MAX_PENDING`), or for its client's share of time, holds up no stop behind it: that starts
at once, and motions that were given before it are refused, as they would follow it.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any, Final

from contid.control.orders import REQUESTS, Right
from contid.remote.protocol.expiry import LASTING
from contid.remote.protocol.wire import STOP_VERBS, Code, RemoteError, decode, is_estop
from contid.remote.server.line_receiver import LineReceiver

#: Share of the loop's time for clients that do not wait for responses.
SHARE: Final = 0.2
#: Time that they may take at once [s]: a few hundred requests sent together are not delayed.
BURST_S: Final = 0.2
#: Least pause [s], so that a rounding error is not waited for.
LEAST_S: Final = 1e-3
#: Requests of one client in progress, and as many orders to stop in their order, and as many that overtook;
#: more wait in its socket.
MAX_PENDING: Final = 32
#: Verbs that wait for no turn in lines of at most `PROMPT_BYTES`: their cost is small and bounded.
PROMPT: Final = frozenset({"hello", "ping"})
PROMPT_BYTES: Final = 1024
#: Requests after which robots may move, or are ready to.
MOTIONS: Final = frozenset(
    verb
    for verb, request in REQUESTS.items()
    if {Right.MOVE, Right.ARM} & (request.rights or set()) and not request.watches and verb not in LASTING
)


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


def check_not_overtaken(verb: object) -> None:
    """Refuse a motion that an order to stop has overtaken.

    Raises:
        RemoteError: it is one.
    """
    if verb in MOTIONS:
        message = f"{verb}: an order to stop came before it had begun; nothing was sent"
        raise RemoteError(Code.STOPPED, message)


class RequestStarter:
    """The requests of one client.

    Args:
        receiver: of its lines.
        turns: of all clients.
        request: serves the request of a line; true for one that an order to stop has overtaken.

    Attributes:
        requests: in progress.
    """

    def __init__(
        self,
        receiver: LineReceiver,
        turns: Turns,
        request: Callable[[bytes, bool], Coroutine[Any, Any, None]],
    ) -> None:
        self.requests: set[asyncio.Task[None]] = set()
        self._receiver = receiver
        self._turns = turns
        self._request = request
        self._pending = asyncio.Semaphore(MAX_PENDING)
        self._stops = asyncio.Semaphore(MAX_PENDING)
        self._waits = False  # the line that was taken last
        self._overtaken = 0  # number of the newest line that a stop has overtaken

    async def start(self, line: bytes) -> None:
        """Start the request of a line that was taken, in its turn."""
        if _stops(line):
            await self._start(self._stops, line)
        elif len(line) <= PROMPT_BYTES and _verb(line) in PROMPT:
            await self._start(self._pending, line)
        else:
            more_wait = bool(self._receiver.lines)
            with self._waiting(more_wait and self._turns.delays):
                async with self._turns.turn(more_wait):
                    await self._start(self._pending, line)

    def overtake(self) -> None:
        """Start the orders to stop behind a line that waits, if one does; called when lines have come."""
        lines = self._receiver.lines
        while self._waits and len(self.requests) < 3 * MAX_PENDING:
            place = next((place for place, line in enumerate(lines) if _stops(line)), None)
            if place is None:
                return
            self._overtaken = self._receiver.taken + place
            self._begin(self._receiver.remove(place), None)

    @contextmanager
    def _waiting(self, waits: bool) -> Iterator[None]:
        self._waits = waits
        self.overtake()
        try:
            yield
        finally:
            self._waits = False

    async def _start(self, slots: asyncio.Semaphore, line: bytes) -> None:
        """Start a request when one more may be in progress; returns after its first step."""
        with self._waiting(slots.locked()):
            await slots.acquire()
        self._begin(line, slots)
        await asyncio.sleep(0)

    def _begin(self, line: bytes, slots: asyncio.Semaphore | None) -> None:
        """Start a request; without ``slots`` it has overtaken others."""
        overtaken = slots is not None and self._receiver.taken <= self._overtaken
        task = asyncio.create_task(self._request(line, overtaken))
        self.requests.add(task)

        def done(task: asyncio.Task[None]) -> None:
            self.requests.discard(task)
            if slots is not None:
                slots.release()

        task.add_done_callback(done)


def _stops(line: bytes) -> bool:
    """True for an order to stop."""
    is_short = len(line) <= PROMPT_BYTES and (b"hold" in line or b"stop" in line)
    return (is_short and _verb(line) in STOP_VERBS) or is_estop(line)


def _verb(line: bytes) -> str | None:
    """The verb of a line; None when it is no request, or its verb is no text."""
    try:
        verb = decode(line).get("verb")
    except RemoteError:
        return None
    return verb if isinstance(verb, str) else None
