"""How long another process waits for a processor: neither computes nor sleeps.

Linux counts how long a thread has computed, and how long it has waited before it ran (schedstat), but not for
how long it waits at present, nor when it has begun to. One that waits at two looks, and did not sleep between
them, has waited in the time between them but for what it has computed. Where it slept, only the waiting that
is over is known, and counts.
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from typing import NamedTuple


class _Look(NamedTuple):
    """What is known of a thread at a time.

    Attributes:
        at_s: the time, on the monotonic clock.
        ran_s: how long it has computed.
        waited_s: how long it has waited for a processor, without the waiting that goes on.
        sleeps: how often it has begun to sleep.
        ready: it computes, or waits for a processor.
    """

    at_s: float
    ran_s: float
    waited_s: float
    sleeps: int
    ready: bool

    def waited_until(self, now: _Look) -> float:
        """How long it waited up to another look [s]."""
        idle_s = max(now.at_s - self.at_s - (now.ran_s - self.ran_s), 0.0)
        if self.ready and now.sleeps == self.sleeps:
            return idle_s
        return min(now.waited_s - self.waited_s, idle_s)


class ProcessTime:
    """The first thread of a process."""

    def __init__(self, pid: int) -> None:
        """Of a process, of none for 0."""
        self.pid = pid
        self._clock = ~pid << 3 | 2  # clock_getcpuclockid(3)
        self._files: list[int] = []
        self._last: _Look | None = None
        with suppress(OSError):
            for name in ("schedstat", "status") if pid else ():
                self._files.append(os.open(f"/proc/{pid}/{name}", os.O_RDONLY))

    def close(self) -> None:
        """It is asked no more."""
        while self._files:
            os.close(self._files.pop())

    def begin(self) -> None:
        """Count from now on."""
        self._last = self._look()

    def waited_s(self) -> float:
        """How long it has waited since it was asked before, or since `begin`; 0 when it is not there."""
        before, self._last = self._last, self._look()
        return 0.0 if before is None or self._last is None else before.waited_until(self._last)

    def _look(self) -> _Look | None:
        try:
            schedstat, status = (os.pread(file, 4096, 0) for file in self._files)
            fields = dict(line.split(b":", 1) for line in status.splitlines())
            ready = fields[b"State"].split()[0] == b"R"
            sleeps = int(fields[b"voluntary_ctxt_switches"])
            waited_s = int(schedstat.split()[1]) * 1e-9
            return _Look(time.monotonic(), time.clock_gettime(self._clock), waited_s, sleeps, ready)
        except (OSError, ValueError, LookupError):
            return None
