"""What the daemon reads from the ring: events for report and listeners, records for the command log.

A command log that cannot be written any more, such as on a full disk, ends; the run goes on.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress

from contid.control.daemon import terminal
from contid.control.daemon.control_child import ControlChild
from contid.control.daemon.report_builder import ReportBuilder
from contid.control.daemon.run_request import RunOptions
from contid.control.engine.command_log import CommandLog
from contid.control.engine.events import RunEvent
from contid.control.engine.tick_layout import RecordLayout

log = logging.getLogger(__name__)


class RingFeed:
    """Events and records of a run, fetched by its daemon.

    Attributes:
        fetching: events are being delivered; a listener must not call `fetch` then.
    """

    def __init__(self, child: ControlChild, report: ReportBuilder, options: RunOptions) -> None:
        self.fetching = False
        self._child = child
        self._report = report
        self._options = options
        self._listeners: list[Callable[[RunEvent], None]] = []
        self._command_log: CommandLog | None = None

    @property
    def missed_ticks(self) -> int:
        """Ticks that are missing in the command log while it is open, else 0."""
        reader = self._child.reader
        return 0 if reader is None or self._command_log is None else reader.missed_ticks

    def listen(self, listener: Callable[[RunEvent], None]) -> None:
        """Call ``listener`` with every further event."""
        self._listeners.append(listener)

    def begin_log(self, layout: RecordLayout) -> None:
        """Open the command log, where the run has one.

        Raises:
            ContidError: it exists, or cannot be written.
        """
        self._command_log = None if self._options.log is None else CommandLog(self._options.log, layout)

    def fetch(self) -> None:
        """Deliver the unread events, and write the unread records into the command log."""
        reader = self._child.reader
        assert reader is not None
        self.fetching = True
        try:
            for event in reader.events():
                self.deliver(event)
        finally:
            self.fetching = False
        if self._command_log is not None:
            try:
                for record in reader.ticks():
                    self._command_log.add(record)
            except OSError as error:
                self.end_log(
                    f"{self._options.log}: the command log ends here, the run continues: {error.strerror}"
                )

    def deliver(self, event: RunEvent) -> None:
        """Pass an event to the report, the terminal and the listeners."""
        self._report.add(event)
        if message := terminal.event_text(event, self._options.log_level):
            terminal.print_message(message)
        for listener in self._listeners:
            listener(event)

    def end_log(self, message: str = "") -> None:
        """Close the command log; ``message``, unless empty, is a problem of the report."""
        command_log, self._command_log = self._command_log, None
        if command_log is not None:
            with suppress(OSError):
                command_log.close()
        if message:
            self._report.problem(message)
            log.warning(message)
