"""Log records of any thread on their way into the ``log`` events of a run.

The control process writes its records (those of the drivers) to the ring; the daemon sends its own to the
control process as `LogWritten`. So the recording, `status` and the terminal get both from the events.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from contid.control.engine.cycle import Sink
from contid.control.engine.events.run import LogWritten

#: Records kept until the next `LogQueue.take`; older ones are dropped.
CAPACITY: Final = 1024
#: Levels of `LogWritten`, highest first; records of other levels get the next lower one, at least the last.
LEVELS: Final = {
    "critical": logging.CRITICAL,
    "error": logging.ERROR,
    "warning": logging.WARNING,
    "info": logging.INFO,
    "debug": logging.DEBUG,
}


def level_name(level: int) -> str:
    """The level of `LogWritten` for a level of `logging`."""
    return next((name for name, lowest in LEVELS.items() if level >= lowest), "debug")


class LogQueue(logging.Handler):
    """Collects log records; safe in threads that must not write to the ring.

    Args:
        process: name of this process in the events.

    Attributes:
        waiting: records that were not taken yet, oldest first.
    """

    def __init__(self, process: str) -> None:
        super().__init__()
        self._process = process
        self.waiting: deque[LogWritten] = deque(maxlen=CAPACITY)

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler.emit`."""
        try:
            message = self.format(record)
        except Exception:  # a wrong format string must not stop a driver
            self.handleError(record)
            return
        level = level_name(record.levelno)
        line = LogWritten(process=self._process, level=level, logger=record.name, message=message)
        self.waiting.append(line)

    def take(self, at_most: int = CAPACITY) -> Iterator[LogWritten]:
        """Remove and return the oldest records, each when the iterator gets to it."""
        for _ in range(min(at_most, len(self.waiting))):
            yield self.waiting.popleft()

    def write(self, sink: Sink, at_most: int = CAPACITY) -> None:
        """Publish the oldest records."""
        for line in self.take(at_most):
            sink.event(line)


@contextmanager
def handle_logs(level: int, *handlers: logging.Handler) -> Iterator[None]:
    """Pass log records of this process from ``level`` on to handlers, within the context."""
    root = logging.getLogger()
    before = root.level
    root.setLevel(level)
    for handler in handlers:
        root.addHandler(handler)
    try:
        yield
    finally:
        root.setLevel(before)
        for handler in handlers:
            root.removeHandler(handler)
