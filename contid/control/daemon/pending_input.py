"""The input of a run while it is not there yet: read and checked aside, so that the daemon serves meanwhile.

A pipe may say nothing for as long as it likes, and a long trajectory takes seconds to check. Until both are
done nothing is handed to the control process and no device is touched. Orders of clients are answered here:
what stops finds nothing to stop and is remembered (the run then connects and waits for `resume`); what would
move is refused.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final

from contid.control.daemon.cancellable_reader import CancellableReader, InputCancelledError
from contid.control.daemon.inputs import Stream
from contid.control.engine.messages import Estop, Goto, Hold, Mark, Message, Play, Resume, Rows, Stop
from contid.trajectory.timed import Trajectory

#: How long the thread may take to notice that nobody waits any more, before it is left behind.
LEAVE_S: Final = 1.0


class PendingInput:
    """An input that is being read.

    Attributes:
        message: what is waited for.
        stopped: somebody stopped the robots before they moved.
    """

    def __init__(self, message: str, read: Callable[[CancellableReader], Trajectory | Stream | None]) -> None:
        """Prepare; ``read`` reads and checks, in a thread of its own."""
        self.message = message
        self.stopped = False
        self._read = read
        self._patience = CancellableReader()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._outcome: asyncio.Future[Trajectory | Stream | None] | None = None

    async def result(self) -> Trajectory | Stream | None:
        """What came in.

        Raises:
            GivenUpError: `give_up` was called.
            ContidError: what is wrong with it.
        """
        self._loop = asyncio.get_running_loop()
        self._outcome = self._loop.create_future()
        thread = threading.Thread(target=self._work, name="contid-input", daemon=True)
        thread.start()
        try:
            return await self._outcome
        finally:
            self._patience.give_up()
            await asyncio.to_thread(thread.join, LEAVE_S)
            if not thread.is_alive():
                self._patience.close()

    def give_up(self) -> None:
        """Wait no longer."""
        if self._outcome is not None and not self._outcome.done():
            self._outcome.set_exception(InputCancelledError())

    def answer(self, order: Message) -> list[Mapping[str, Any]]:
        """The events with which a run that has not begun obeys an order."""
        match order:
            case Mark(number):
                return [{"event": "mark", "number": number, "tick": 0}]
            case Hold() | Stop() | Estop():
                self.stopped = True
            case Resume() | Goto() | Rows() | Play():
                message = f"{self.message}; nothing is connected yet"
                return [{"event": "refused", "robot": "", "message": message}]
        return []

    def _work(self) -> None:
        assert self._loop is not None
        came: Trajectory | Stream | None = None
        error: Exception | None = None
        try:
            came = self._read(self._patience)
        except Exception as caught:  # whatever it is, it is told where the result is waited for
            error = caught
        with suppress(RuntimeError):  # the loop is closed: nobody waits
            self._loop.call_soon_threadsafe(self._tell, came, error)

    def _tell(self, came: Trajectory | Stream | None, error: Exception | None) -> None:
        assert self._outcome is not None
        if self._outcome.done():
            return
        if error is None:
            self._outcome.set_result(came)
        else:
            self._outcome.set_exception(error)
