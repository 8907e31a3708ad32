"""The way of orders to the control process; before the run begins, the pending input answers them."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence

from contid.control.daemon.control_child import ControlChild
from contid.control.daemon.interfaces import RunObserver
from contid.control.daemon.pending_input import PendingInput
from contid.control.daemon.report_builder import ReportBuilder
from contid.control.engine.events import RunEvent
from contid.control.engine.events.run import NoteWritten
from contid.control.engine.messages import Message, Play
from contid.control.process.log_queue import LogQueue
from contid.errors import ContidError

log = logging.getLogger(__name__)


class OrderChannel:
    """Orders of one run.

    Attributes:
        pending: the input that the run waits for; None once it has begun.

    Args:
        deliver: called with the events that answer orders before the run begins.
    """

    def __init__(
        self,
        child: ControlChild,
        pending: PendingInput | None,
        observers: Sequence[RunObserver],
        report: ReportBuilder,
        deliver: Callable[[RunEvent], None],
        logs: LogQueue,
    ) -> None:
        self.pending = pending
        self._child = child
        self._observers = observers
        self._report = report
        self._deliver = deliver
        self._logs = logs

    def send(self, message: Message) -> None:
        """Send an order."""
        if self.pending is not None:
            for event in self.pending.answer(message):
                asyncio.get_running_loop().call_soon(self._deliver, event)
            return
        if isinstance(message, Play):
            self._notify_observers(message)
        if self._logs.waiting:
            self.forward_logs()
        self._child.send(message)

    def note(self, event: NoteWritten) -> None:
        """Have a note written into the events of the run."""
        if self.pending is None:
            self._child.send(event)

    def forward_logs(self) -> None:
        """Send log records to the control process, which writes them to the ring."""
        for line in self._logs.take():
            self._child.send(line)

    def _notify_observers(self, message: Play) -> None:
        """Give the observers the trajectory of an order before the control process gets it."""
        for observer in self._observers:
            try:
                observer.before_order(message)
            except ContidError as error:  # a full disk or memory stops no move
                self._report.problem(str(error))
                log.warning(str(error))
