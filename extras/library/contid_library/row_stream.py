"""Rows of a stream or a trajectory, pipelined: sent as far as they are granted, responses come later.

A row is one set-point of a stream, or one timed row of a trajectory. The daemon takes rows only as far as it
has room. It states this as a credit: ``granted`` is the number of rows that it accepts so far for the move in
all, those already sent included, and it only grows. So a client need not have the response to one row before
it sends the next: over a link with latency as many rows are under way as are granted, instead of one per
round trip. While it waits it pings, which renews its lease.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import AsyncIterable, AsyncIterator, Iterable, Sequence
from typing import Final

from contid.remote.client.client_protocol import Request
from contid.remote.client.orders import Orders
from contid.remote.protocol.wire import Code, RemoteError

#: Rows of a timed trajectory in one request.
BATCH_ROWS: Final = 256
#: Requests that are not yet responded to; a further one waits.
MAX_UNANSWERED: Final = 16
#: Time to take in responses that have come, before a row is sent [s].
LOOK_S: Final = 0.001


class RowStream:
    """The rows of one move.

    Args:
        client: connected client.
        move: number of the move, from the response to ``move``.
        timed: True for rows with times, all of which count; of rows without times the newest counts.
        credits: rows that the daemon has granted so far.

    Attributes:
        refused: messages about rows that the daemon refused one by one.
    """

    def __init__(self, client: Orders, move: int, timed: bool, credits: int) -> None:
        self.refused: list[str] = []
        self._client = client
        self._protocol = client._protocol
        self._move = move
        self._timed = timed
        self._batch_rows = min(credits, BATCH_ROWS) if timed else 1
        self._sent = 0
        self._unanswered: deque[tuple[float, Request]] = deque()

    async def send(self, rows: Iterable[Sequence[float]] | AsyncIterable[Sequence[float]]) -> None:
        """Send rows as they come, and wait for the responses to all.

        Raises:
            RemoteError: the move was stopped, or rows were refused as a whole.
        """
        try:
            batch: list[list[float]] = []
            async for row in iterate(rows):
                batch.append(list(row))
                if len(batch) >= self._batch_rows:
                    await self._send(batch)
                    batch = []
            if batch:
                await self._send(batch)
            while self._unanswered:
                await self._client._listen()
                self._take()
        finally:
            for _, request in self._unanswered:
                self._protocol.forget(request)

    async def _send(self, rows: list[list[float]]) -> None:
        """Send one request with rows, once they are granted and `MAX_UNANSWERED` allows it."""
        if self._unanswered:
            await self._client._wait_notice(LOOK_S)
        self._take()
        while not self._may_send(len(rows)):
            await self._client._listen()
            self._take()
            if self._protocol.arrived(self._move):
                break  # the daemon refuses further rows with the reason
        request = self._protocol.request("rows", {"move": self._move, "rows": rows})
        self._unanswered.append((time.monotonic(), request))
        self._sent += len(rows)
        await self._client._post(request)

    def _may_send(self, rows: int) -> bool:
        """Whether further rows may be sent; too many timed rows are refused by the daemon, not waited for."""
        granted = self._timed or self._sent + rows <= self._protocol.granted.get(self._move, 0)
        return granted and len(self._unanswered) < MAX_UNANSWERED

    def _take(self) -> None:
        """Take in the responses that have come, the oldest first."""
        while self._unanswered:
            sent_s, request = self._unanswered[0]
            try:
                result = self._protocol.result(request)
            except RemoteError as error:
                self._unanswered.popleft()
                if self._timed or error.code != Code.SUPERSEDED:  # of live rows the newest counts
                    raise
                continue
            if result is None:
                if time.monotonic() - sent_s > request.timeout_s:
                    raise self._protocol.lost(f"no response within {request.timeout_s:g} s")
                return
            self._unanswered.popleft()
            self.refused += result["refused"]


async def iterate(
    rows: Iterable[Sequence[float]] | AsyncIterable[Sequence[float]],
) -> AsyncIterator[Sequence[float]]:
    """The rows of an iterable of either kind, plain or asynchronous."""
    if isinstance(rows, AsyncIterable):
        async for row in rows:
            yield row
    else:
        for row in rows:
            yield row
