"""Output of a run on the terminal: messages, and a progress line that is rewritten below them."""

from __future__ import annotations

import logging
import math
import sys
from collections.abc import Callable
from typing import Final

from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import BusChanged, OverloadChanged, TicksSkipped
from contid.control.engine.events.robots import (
    ContactBegan,
    FaultLatched,
    OrderRefused,
    PathSlowed,
    SqueezeChanged,
)
from contid.control.engine.events.run import LogWritten, RunStarted
from contid.control.engine.tick_layout import RecordLayout, TickRecord
from contid.control.process.log_queue import LEVELS, level_name
from contid.control.tick.supervisor import Mode

#: Return to the first column and erase the line.
CLEAR: Final = "\r\x1b[K"
#: Updates of the progress line [Hz].
PROGRESS_HZ: Final = 5.0
#: The check of a trajectory with more rows shows its progress.
LONG_TRAJECTORY_ROWS: Final = 20_000


def print_message(message: str) -> None:
    """Print a message in place of the progress line."""
    clear = CLEAR if sys.stderr.isatty() else ""
    sys.stderr.write(f"{clear}contid: {message}\n")
    sys.stderr.flush()


class TerminalHandler(logging.Handler):
    """Prints log records."""

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler.emit`."""
        try:
            print_message(log_text(level_name(record.levelno), self.format(record)))
        except Exception:
            self.handleError(record)


def log_text(level: str, message: str) -> str:
    """A log record for the terminal; the level is shown when it is not ``info``."""
    return message if level == "info" else f"{level}: {message}"


def event_text(event: RunEvent, log_level: int = logging.INFO) -> str:
    """The message of an event for the terminal; "" for events that are not shown."""
    match event:
        case LogWritten():
            # The daemon has printed its own records already.
            shown = event.process == "control" and LEVELS[event.level] >= log_level
            return log_text(event.level, event.message) if shown else ""
        case FaultLatched() | ContactBegan() | SqueezeChanged() | PathSlowed():
            return f"{event.robot}: {event.message}"
        case OrderRefused():
            return f"refused: {event.message}"
        case BusChanged() | RunStarted():
            return event.message
        case TicksSkipped() | OverloadChanged():
            return str(event)
    return ""


class ProgressLine:
    """States of the robots and time in the trajectory in one line; on terminals, and not with ``-q``."""

    def __init__(self, layout: RecordLayout, log_level: int) -> None:
        self._names = [robot.name for robot in layout.robots]
        self._ticks_between = layout.rate_hz / PROGRESS_HZ
        self._terminal = sys.stderr.isatty() and log_level <= logging.INFO
        self._shown = -math.inf

    def show(self, newest: Callable[[], TickRecord | None], end_s: float | None) -> None:
        """Show the newest record at `PROGRESS_HZ`; fetches it on terminals only.

        Args:
            newest: returns the newest record, None before the first.
            end_s: end of the trajectory, if there is one.
        """
        record = newest() if self._terminal else None
        if record is None or record.tick - self._shown < self._ticks_between:
            return
        self._shown = record.tick
        modes = ", ".join(
            f"{name} {Mode(robot.mode).name}" for name, robot in zip(self._names, record.robots, strict=True)
        )
        end = "" if end_s is None else f"/{end_s:.1f}"
        at = "" if math.isnan(record.source_s) else f"  t {record.source_s:.1f}{end} s"
        skipped = f"  {record.skipped} skipped" if record.skipped else ""
        _write(f"{modes}{at}{skipped}")

    def clear(self) -> None:
        """Erase the line."""
        if self._terminal:
            _write("")


def check_progress(rows: int) -> Callable[[int, int], None]:
    """A callback that shows rows checked and rows in total."""
    if rows < LONG_TRAJECTORY_ROWS or not sys.stderr.isatty():
        return lambda done, total: None
    return lambda done, total: _write(f"checking the trajectory: {100 * done // total} %")


def _write(line: str) -> None:
    sys.stderr.write(f"{CLEAR}{line}")
    sys.stderr.flush()
