"""Deadlines of the end of a run: orderly stop, then relax, then kill.

The control process reports how long its stop takes. `STOP_GRACE_S` after that time it must relax or vent;
`KILL_GRACE_S` later it is killed and the devices' own watchdogs stop them. Pure computation on given times.
"""

from __future__ import annotations

import enum
from typing import Final

#: Allowed for the report of the stopping time, and beyond that time for the stop itself.
STOP_GRACE_S: Final = 0.8
#: From relaxing to SIGKILL; both together stay below the 2 s a user waits before pressing Ctrl-C again.
KILL_GRACE_S: Final = 0.5


class Escalation(enum.Enum):
    """The action that is due."""

    NOTHING = enum.auto()
    RELAX = enum.auto()
    KILL = enum.auto()


class ShutdownSequence:
    """The deadlines of one shutdown.

    Attributes:
        requests: number of requests to end the run.
    """

    def __init__(self) -> None:
        self.requests = 0
        self._relax_at_s: float | None = None
        self._kill_at_s: float | None = None

    def stop(self, now_s: float) -> None:
        """The orderly stop was ordered; its duration is not reported yet."""
        self._relax_at_s = now_s + STOP_GRACE_S

    def stop_takes(self, seconds: float, now_s: float) -> None:
        """The control process reported how long its stop takes from now on."""
        if self._relax_at_s is not None:
            self._relax_at_s = now_s + seconds + STOP_GRACE_S

    def relax(self, now_s: float) -> None:
        """Relaxing was ordered; only the end of the process is outstanding."""
        self._relax_at_s = None
        if self._kill_at_s is None:  # repeating the order postpones nothing
            self._kill_at_s = now_s + KILL_GRACE_S

    def due(self, now_s: float) -> Escalation:
        """The action due at ``now_s``."""
        if self._relax_at_s is not None and now_s > self._relax_at_s:
            return Escalation.RELAX
        if self._kill_at_s is not None and now_s > self._kill_at_s:
            return Escalation.KILL
        return Escalation.NOTHING
