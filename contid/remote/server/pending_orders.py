"""Orders to the control process and what became of them.

The pipe keeps its order, and so does the ring: after some orders a `Mark` is sent; the refusals that come
back before that mark belong to them. So a client's answer says what the control process did, not what was
asked of it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from contid.control.engine.messages import Mark, Message
from contid.remote.protocol.wire import Code, RemoteError

#: The control process confirms within a tick; the daemon looks every 20 ms.
PATIENCE_S: Final = 3.0
#: What was sent in bulk crosses the pipe in parts, beside everything else.
BULK_S: Final = 30.0


@dataclass(slots=True)
class OrderResult:
    """What became of some orders.

    Attributes:
        tick: before which they were obeyed.
        refused: words by robot.
    """

    tick: int = 0
    refused: dict[str, str] = field(default_factory=dict)


class PendingOrders:
    """Marks that are under way."""

    def __init__(self, send: Callable[[Message], None]) -> None:
        self._send = send
        self._number = 0
        self._open: int | None = None
        self._waiting: dict[int, tuple[OrderResult, asyncio.Future[OrderResult]]] = {}

    def order(self, orders: Sequence[Message]) -> asyncio.Future[OrderResult]:
        """Send orders at once; the future tells what became of them."""
        number = self._number = self._number + 2
        # One mark before, too: what is refused outside of the two is not ours.
        self._send(Mark(number - 1))
        for order in orders:
            self._send(order)
        self._send(Mark(number))
        return self._expect(number)

    def mark_bulk(self, send_bulk: Callable[[Message], None]) -> asyncio.Future[OrderResult]:
        """The future of what was sent in bulk before."""
        number = self._number = self._number + 2
        send_bulk(Mark(number))
        return self._expect(number)

    def _expect(self, number: int) -> asyncio.Future[OrderResult]:
        future: asyncio.Future[OrderResult] = asyncio.get_running_loop().create_future()
        self._waiting[number] = (OrderResult(), future)
        return future

    async def confirmed(
        self, future: asyncio.Future[OrderResult], patience_s: float = PATIENCE_S
    ) -> OrderResult:
        """Wait for what became of orders.

        Raises:
            RemoteError: nothing came back in time; the orders were sent all the same.
        """
        try:
            async with asyncio.timeout(patience_s):
                return await future
        except TimeoutError:
            message = f"sent, but the control process has not confirmed it within {patience_s:g} s"
            raise RemoteError(Code.NO_ANSWER, message) from None

    def notice(self, event: Mapping[str, Any]) -> None:
        """An event of the ring."""
        if event["event"] == "mark":
            number = int(event["number"])
            self._open = number + 1 if number % 2 else None
            if number % 2 == 0:
                outcome, future = self._waiting.pop(number, (OrderResult(), None))
                outcome.tick = int(event["tick"])
                if future is not None and not future.done():
                    future.set_result(outcome)
        elif event["event"] == "refused" and self._open in self._waiting:
            self._waiting[self._open][0].refused[str(event.get("robot", ""))] = str(event["message"])

    def close(self) -> None:
        """Nobody will confirm any more."""
        for _, future in self._waiting.values():
            future.cancel()
        self._waiting.clear()
