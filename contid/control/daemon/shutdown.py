"""When a run that shall end is pressed on: first an orderly stop, then no torque, then no process.

The control process is asked to stop and tells how long its motion takes; `PATIENCE_S` beyond that it has to
relax or vent at once, and `END_S` later it is killed and the devices' own dead-man is what stops them. Pure
bookkeeping with the time given; the daemon acts on what it returns.
"""

from __future__ import annotations

import enum
from typing import Final

#: How long the control process may take to say how long its stop takes, and how much longer than that it may
#: take; then it relaxes at once, and after `END_S` it is killed. Together less than the 2 s that people wait.
PATIENCE_S: Final = 0.8
END_S: Final = 0.5


class Escalation(enum.Enum):
    """What is due."""

    NOTHING = enum.auto()
    RELAX = enum.auto()
    KILL = enum.auto()


class ShutdownSequence:
    """The deadlines of one ending.

    Attributes:
        asked: how often somebody asked the run to end.
    """

    def __init__(self) -> None:
        self.asked = 0
        self._relax_at_s: float | None = None
        self._kill_at_s: float | None = None

    def stop(self, now_s: float) -> None:
        """The orderly stop was ordered; how long it takes is not known yet."""
        self._relax_at_s = now_s + PATIENCE_S

    def takes(self, seconds: float, now_s: float) -> None:
        """The control process says how long its stop takes from now on."""
        if self._relax_at_s is not None:
            self._relax_at_s = now_s + seconds + PATIENCE_S

    def relax(self, now_s: float) -> None:
        """It was told to relax at once; only the end of the process is waited for."""
        self._relax_at_s = None
        self._kill_at_s = now_s + END_S

    def due(self, now_s: float) -> Escalation:
        """What has to be done now."""
        if self._relax_at_s is not None and now_s > self._relax_at_s:
            return Escalation.RELAX
        if self._kill_at_s is not None and now_s > self._kill_at_s:
            return Escalation.KILL
        return Escalation.NOTHING
