"""How long another process waits for a processor: neither computes nor sleeps.

What it has waited is in schedstat once it runs again or sleeps; while it still waits, it is what it has not
computed.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias

#: How long it has waited since it was asked first, of a time that has passed since then [s].
Waiting: TypeAlias = Callable[[float], float]


class ProcessTime:
    """The first thread of a process, and its clock (`clock_getcpuclockid`)."""

    def __init__(self, pid: int) -> None:
        """Of a process, of none for 0."""
        self.pid = pid
        self._clock = ~pid << 3 | 2
        self._schedule = -1
        with suppress(OSError):
            if pid:
                self._schedule = os.open(f"/proc/{pid}/schedstat", os.O_RDONLY)

    def close(self) -> None:
        """It is asked no more."""
        if self._schedule >= 0:
            os.close(self._schedule)
            self._schedule = -1

    def waiting(self) -> Waiting:
        """How long it waits from now on; 0 of a process that is not there."""
        try:
            ran_s, waited_s = time.clock_gettime(self._clock), self._waited_s()
        except (OSError, IndexError):
            return lambda passed_s: 0.0

        def since(passed_s: float) -> float:
            with suppress(OSError, IndexError):
                state = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()[0]
                if state == "R":
                    return max(passed_s - (time.clock_gettime(self._clock) - ran_s), 0.0)
                return self._waited_s() - waited_s
            return 0.0

        return since

    def _waited_s(self) -> float:
        return int(os.pread(self._schedule, 64, 0).split()[1]) * 1e-9
