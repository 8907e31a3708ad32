"""Orders sent to the control process, and their results.

Pipe and ring keep their order: a `Mark` before some orders gives them a number, which is in their refusals,
and one behind them confirms them. So a response states what the control process did. What robots refuse
beside orders, as in a tick between the two marks, has no number.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import MarkReached, OrderRefused
from contid.control.engine.messages import Mark, Message
from contid.control.engine.tick_layout import TickRecord
from contid.remote.protocol.wire import Code, Fields, RemoteError

CONFIRM_TIMEOUT_S: Final = 3.0
#: The control process confirms within a tick. After an order the ring is read in this period, at most `POLLS`
#: times; then with the events of the run.
POLL_S: Final = 2e-3
POLLS: Final = 25
#: A result waits at most this long for the record of its tick. Only a control process that has just died
#: writes none.
RECORD_TIMEOUT_S: Final = 1.0


@dataclass(slots=True)
class OrderResult:
    """The result of some orders.

    Attributes:
        tick: before which they were obeyed.
        refused: messages by robot.
        stronger: messages by robot of which an earlier stop goes on that leaves less power.
        record: of that tick, once it is `PendingOrders.confirmed`.
    """

    tick: int = 0
    record: TickRecord | None = None
    refused: dict[str, str] = field(default_factory=dict)
    stronger: dict[str, str] = field(default_factory=dict)

    def refusal(self, faults: Mapping[str, Fields]) -> RemoteError:
        """The error of orders of which robots refused some; both arms of a chain have the same message."""
        message = "; ".join(dict.fromkeys(self.refused.values()))
        return RemoteError(Code.FAULT if faults else Code.REFUSED, message, faults)


class PendingOrders:
    """Orders that are not yet confirmed."""

    def __init__(self, control: RunControl) -> None:
        self._control = control
        self._polls = 0
        self._timer: asyncio.TimerHandle | None = None
        self._number = 0
        self._waiting: dict[int, tuple[OrderResult, asyncio.Future[OrderResult]]] = {}

    def send(self, orders: Sequence[Message]) -> asyncio.Future[OrderResult]:
        """Send orders at once; returns the future of their result."""
        number = self._number = self._number + 2
        for message in (Mark(number - 1), *orders, Mark(number)):
            self._control.send(message)
        loop = asyncio.get_running_loop()
        future: asyncio.Future[OrderResult] = loop.create_future()
        self._waiting[number] = (OrderResult(), future)
        self._polls = POLLS
        if self._timer is None:
            self._timer = loop.call_later(POLL_S, self._poll)
        return future

    def _poll(self) -> None:
        self._timer = None
        self._polls -= 1
        self._control.refresh()
        if self._waiting and self._polls > 0:
            self._timer = asyncio.get_running_loop().call_later(POLL_S, self._poll)

    async def confirmed(
        self, future: asyncio.Future[OrderResult], timeout_s: float = CONFIRM_TIMEOUT_S
    ) -> OrderResult:
        """Wait for the result of orders, and for the record of the tick that obeyed them.

        Raises:
            RemoteError: no confirmation in time; the orders were sent all the same.
        """
        try:
            async with asyncio.timeout(timeout_s):
                result = await asyncio.shield(future)  # it may be confirmed later
        except TimeoutError:
            message = f"sent, but the control process has not confirmed it within {timeout_s:g} s"
            raise RemoteError(Code.NO_ANSWER, message) from None
        deadline_s = time.monotonic() + RECORD_TIMEOUT_S
        while (found := self._control.record_of(result.tick)) is None and time.monotonic() < deadline_s:
            await asyncio.sleep(POLL_S)
        result.record = found or self._control.newest()
        return result

    def notice(self, event: RunEvent) -> None:
        """Take in an event of the ring."""
        if isinstance(event, MarkReached):
            outcome, future = self._waiting.pop(event.number, (OrderResult(), None))
            outcome.tick = event.tick
            if future is not None and not future.done():
                future.set_result(outcome)
        elif isinstance(event, OrderRefused) and event.answers in self._waiting:
            result, _ = self._waiting[event.answers]
            (result.stronger if event.stronger else result.refused)[event.robot] = event.message

    def close(self) -> None:
        """Cancel what will not be confirmed any more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        for _, future in self._waiting.values():
            future.cancel()
        self._waiting.clear()
