"""The input of a run before it is complete: read and checked in a thread while the daemon serves clients.

A pipe may stay silent for any time, and checking a long trajectory takes seconds. Meanwhile nothing is sent
to the control process and no device is opened. Orders of clients are answered here: an order to stop is kept
(the run then connects and waits for `resume`), one that needs devices is refused.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from contid.control.daemon.inputs import CancellableReader, InputCancelledError, Stream
from contid.control.engine import messages as msg
from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import MarkReached, OrderRefused
from contid.trajectory.timed import Trajectory

#: The thread may take so long to end after `cancel`; then it is left running.
JOIN_TIMEOUT_S: Final = 1.0


class PendingInput:
    """An input that is being read.

    Attributes:
        message: what the run waits for.
        stopped: a client ordered a stop before the run began.
    """

    def __init__(self, message: str, read: Callable[[CancellableReader], Trajectory | Stream | None]) -> None:
        """Prepare; ``read`` reads and checks in a thread of its own."""
        self.message = message
        self.stopped = False
        self._read = read
        self._reader = CancellableReader()
        self._cancelled = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._order = 0  # number of the order that is answered
        self._outcome: asyncio.Future[Trajectory | Stream | None] | None = None

    async def result(self) -> Trajectory | Stream | None:
        """Wait for the input.

        Raises:
            InputCancelledError: `cancel` was called.
            ContidError: the input is wrong.
        """
        self._loop = asyncio.get_running_loop()
        self._outcome = self._loop.create_future()
        thread = threading.Thread(target=self._work, name="contid-input", daemon=True)
        thread.start()
        try:
            return await self._outcome
        finally:
            self._reader.cancel()
            await asyncio.to_thread(thread.join, JOIN_TIMEOUT_S)
            if not thread.is_alive():
                self._reader.close()
            if self._cancelled:  # perhaps while the thread ended, after the whole input was read
                raise InputCancelledError

    def cancel(self) -> None:
        """Make `result` raise `InputCancelledError`, also where the input has been read meanwhile."""
        self._cancelled = True
        if self._outcome is not None and not self._outcome.done():
            self._outcome.set_exception(InputCancelledError())

    def answer(self, order: msg.Message) -> list[RunEvent]:
        """The events that answer an order before the run has begun."""
        match order:
            case msg.Mark(number):
                self._order = number + 1 if number % 2 else 0
                return [MarkReached(number=number, tick=0)]
            case msg.Hold() | msg.Stop() | msg.Estop():
                self.stopped = True
            case (
                msg.Resume() | msg.Follow() | msg.Recover() | msg.Goto() | msg.Rows() | msg.Play()
                | msg.Start() | msg.Grip()
            ):  # fmt: skip
                message = f"{self.message}; nothing is connected yet"
                return [OrderRefused(message=message, answers=self._order)]
        return []

    def _work(self) -> None:
        assert self._loop is not None
        result: Trajectory | Stream | None = None
        error: Exception | None = None
        try:
            result = self._read(self._reader)
        except Exception as caught:  # raised again by `result`
            error = caught
        with suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self._deliver, result, error)

    def _deliver(self, result: Trajectory | Stream | None, error: Exception | None) -> None:
        assert self._outcome is not None
        if self._outcome.done():
            return
        if error is None:
            self._outcome.set_result(result)
        else:
            self._outcome.set_exception(error)
