"""What a kept process prints and logs, in one pipe; limited, so that a flood costs only its own robots."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, Final

#: Begins a line that is a log record; other lines were printed by foreign code or a library of it.
RECORD: Final = "\x1e"
#: Lines forwarded per second; the others are counted.
LINES_PER_S: Final = 20
#: Longest line [bytes].
LONGEST_LINE: Final = 1000
#: Characters of the name of a logger in a line, and most bytes of a character in JSON: two escapes.
LONGEST_NAME: Final = 60
LONGEST_ESCAPE: Final = 12


class PipeHandler(logging.Handler):
    """Writes log records of the kept process to a descriptor, a line each."""

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self._descriptor = descriptor

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler.emit`."""
        try:
            text = self.format(record)
        except Exception:  # a wrong format string must not stop what is served
            self.handleError(record)
            return
        with suppress(OSError):
            os.write(self._descriptor, record_line(record.levelno, record.name, text))


def record_line(level: int, logger: str, text: str) -> bytes:
    """A log record as a line of at most `LONGEST_LINE` bytes.

    Its text is cut for that: `LineLimit` cuts longer lines, and what is left of the JSON would be no record.
    """
    logger = logger[:LONGEST_NAME]
    text = text[:LONGEST_LINE]
    while len(line := f"{RECORD}{json.dumps([level, logger, text])}") > LONGEST_LINE:
        text = text[: -max((len(line) - LONGEST_LINE) // LONGEST_ESCAPE, 1)]
    return f"{line}\n".encode()


class LineLimit:
    """Splits what was read from the pipe into lines and lets a limited number pass."""

    def __init__(self, logger: str) -> None:
        """``logger`` is the name of the log records that are made of printed lines."""
        self._logger = logger
        self._rest = b""
        self._begun_s = 0.0
        self._passed = self._dropped = 0

    def take(self, data: bytes, now_s: float) -> Iterator[list[Any]]:
        """The records to forward, as level, logger and text.

        `LINES_PER_S` counts lines of every level: a flood of errors costs as much as one of prints.
        """
        if now_s - self._begun_s >= 1.0:
            if self._dropped:
                yield [logging.WARNING, self._logger, f"{self._dropped} more lines of output are left out"]
            self._begun_s, self._passed, self._dropped = now_s, 0, 0
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LONGEST_LINE:
            lines.append(self._rest)
            self._rest = b""
        for line in filter(None, lines):
            if self._passed >= LINES_PER_S:
                self._dropped += 1
                continue
            self._passed += 1
            yield self._record(line[:LONGEST_LINE].decode(errors="replace"))

    def _record(self, line: str) -> list[Any]:
        if line.startswith(RECORD):
            with suppress(ValueError):
                level, logger, text = json.loads(line.removeprefix(RECORD))
                return [int(level), str(logger), str(text)]
        return [logging.INFO, self._logger, "".join(each if each.isprintable() else "?" for each in line)]
