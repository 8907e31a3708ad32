"""What the person at the terminal sees of a run: messages, and a line of progress that gives way to them."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from typing import Any, Final

from contid.control.engine.tick_layout import RecordLayout, TickRecord
from contid.control.tick.supervisor import Mode

#: Back to the first column, and nothing left of what stood there.
CLEAR: Final = "\r\x1b[K"
#: How often the line of progress is written [Hz].
PROGRESS_HZ: Final = 5.0
#: A trajectory with more rows than this shows how far its check has come.
LONG: Final = 20_000


def say(message: str) -> None:
    """A message for a person; the line of progress makes room for it."""
    clear = CLEAR if sys.stderr.isatty() else ""
    sys.stderr.write(f"{clear}contid: {message}\n")
    sys.stderr.flush()


def words_of(event: Mapping[str, Any]) -> str:
    """What a person is told of an event of the run; "" for one that is for others."""
    match event["event"]:
        case "fault":
            return f"{event['robot']}: {event['message']}"
        case "refused":
            return f"refused: {event['message']}"
        case "bus" | "started":
            return str(event["message"])
        case "skipped":
            what = "1 tick" if event["ticks"] == 1 else f"{event['ticks']} ticks"
            return f"{what} skipped ({event['total']} in all)"
    return ""


class ProgressLine:
    """States of the robots and time in the trajectory, in one line; nothing where no terminal is."""

    def __init__(self, layout: RecordLayout) -> None:
        self._names = [robot.name for robot in layout.robots]
        self._ticks_between = layout.rate_hz / PROGRESS_HZ
        self._terminal = sys.stderr.isatty()
        self._shown = -math.inf

    def show(self, newest: Callable[[], TickRecord | None], end_s: float | None) -> None:
        """Show the newest record when it is time, and ask for it only where somebody may see it.

        Args:
            newest: the newest record, None before the first.
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
        """Leave an empty line."""
        if self._terminal:
            _write("")


def checking(rows: int) -> Callable[[int, int], None]:
    """Shows how far the check of a trajectory has come: called with rows done and rows in all."""
    if rows < LONG or not sys.stderr.isatty():
        return lambda done, total: None
    return lambda done, total: _write(f"checking the trajectory: {100 * done // total} %")


def _write(line: str) -> None:
    sys.stderr.write(f"{CLEAR}{line}")
    sys.stderr.flush()
