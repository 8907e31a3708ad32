"""What a bus process prints and logs, in one pipe; limited, so that a flood costs only its own bus."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, Final

#: Begins a line that is a log record; other lines were printed by the driver or a library of it.
RECORD: Final = "\x1e"
#: Lines forwarded per second; the others are counted.
LINES_PER_S: Final = 20
#: Longest line [bytes].
LONGEST_LINE: Final = 1000


class PipeHandler(logging.Handler):
    """Writes log records of the bus process to a descriptor, a line each."""

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self._descriptor = descriptor

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler.emit`."""
        try:
            text = self.format(record)
        except Exception:  # a wrong format string must not stop a driver
            self.handleError(record)
            return
        line = json.dumps([record.levelno, record.name, text[: LONGEST_LINE // 2]])
        with suppress(OSError):
            os.write(self._descriptor, f"{RECORD}{line}\n".encode())


class LineLimit:
    """Splits what was read from the pipe into lines and lets a limited number pass."""

    def __init__(self, logger: str) -> None:
        """``logger`` is the name of the log records of lines that are none."""
        self._logger = logger
        self._rest = b""
        self._begun_s = 0.0
        self._passed = self._dropped = 0

    def take(self, data: bytes, now_s: float) -> Iterator[list[Any]]:
        """The records to forward, as level, logger and text."""
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
