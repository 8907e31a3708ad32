"""The end of a run: the signals that ask for it, and its deadlines: orderly stop, then relax, then kill.

The control process reports how long its stop takes. `STOP_GRACE_S` after that time it must relax or vent;
`KILL_GRACE_S` later it is killed and the devices' own watchdogs stop them. The deadlines are pure computation
on given times.
"""

from __future__ import annotations

import asyncio
import enum
import signal
from collections.abc import Callable
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


class RunSignals:
    """Handlers of SIGINT, SIGTERM, SIGTSTP and, without nohup, SIGHUP in the loop of a run.

    Args:
        interrupt: for SIGINT and SIGTERM.
        hung_up: for SIGHUP, and for SIGTSTP (Ctrl-Z): a suspended daemon would let the robots go on, and
            would pass on no stop.
    """

    def __init__(self, interrupt: Callable[[], None], hung_up: Callable[[], None]) -> None:
        self._handlers = {signal.SIGINT: interrupt, signal.SIGTERM: interrupt, signal.SIGTSTP: hung_up}
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # nohup
            self._handlers[signal.SIGHUP] = hung_up

    def handle(self) -> None:
        """Handle them from now on."""
        for number, handler in self._handlers.items():
            asyncio.get_running_loop().add_signal_handler(number, handler)

    def ignore(self) -> None:
        """Ignore further ones during the clean-up: raised in a task they would print a traceback."""
        for number in self._handlers:
            asyncio.get_running_loop().add_signal_handler(number, _ignore)

    def remove(self) -> None:
        """Restore the handlers of the interpreter."""
        for number in self._handlers:
            asyncio.get_running_loop().remove_signal_handler(number)


def _ignore() -> None:
    """Handler of a signal after the robots have come to rest."""
