"""Watches from the daemon whether the control process ticks, and ends one that stands still.

The time in which it could not have ticked does not count: that in which the daemon itself did not run (a
machine that was suspended, or that is overloaded), and that in which a thread of the control process waited
for a processor. Neither do requests to devices (arming, clearing) in the thread of the tick, which may take
seconds, unless a signal has stopped the process; nor the time before the first tick and after the last. A
tick that takes long counts while it lasts; once it is complete everything begins again.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from pathlib import Path
from typing import Final

#: Silence that is reported: three periods of the tick, and at least this time [s].
REPORTED_S: Final = 0.05
REPORTED_PERIODS: Final = 3.0
#: Silence after which the control process is killed, and at least twice what is reported [s].
KILLED_S: Final = 0.5
#: Most of the time between two looks that counts [s]; the daemon looks more often unless it does not run.
MOST_S: Final = 0.04


class Silence(enum.Enum):
    """What a look found."""

    TICKS = enum.auto()
    BEGAN = enum.auto()
    LASTS = enum.auto()
    OVER = enum.auto()
    KILL = enum.auto()


class SilenceWatch:
    """The silence of one control process.

    Attributes:
        silent_s: how long it has been silent, or was the last time, as far as that counts.
    """

    def __init__(self, rate_hz: float, activity: Callable[[], Activity]) -> None:
        """Watch a control process; ``activity`` finds what it does, and is called only while it is silent."""
        self.silent_s = self._counted_s = 0.0
        self._reported_s = max(REPORTED_S, REPORTED_PERIODS / rate_hz)
        self._killed_s = max(KILLED_S, 2.0 * self._reported_s)
        self._activity = activity
        self._ticks = 0
        self._looked_s = 0.0
        self._reported = False

    def look(self, ticks: int, preparing: bool, now_s: float) -> Silence:
        """Look at the number of ticks that are complete.

        Args:
            ticks: 0 before the first one.
            preparing: a request to devices is under way that may take longer than a tick.
            now_s: the time.
        """
        passed_s, self._looked_s = min(now_s - self._looked_s, MOST_S), now_s
        if ticks != self._ticks or not ticks:
            self._ticks, self._counted_s = ticks, 0.0
            reported, self._reported = self._reported, False
            return Silence.OVER if reported else Silence.TICKS
        activity = self._activity()
        if activity is Activity.STOPPED or (activity is Activity.GOES_ON and not preparing):
            self._counted_s += passed_s
            self.silent_s = self._counted_s
        if self._counted_s > self._killed_s:
            return Silence.KILL
        if self._counted_s > self._reported_s and not self._reported:
            self._reported = True
            return Silence.BEGAN
        return Silence.LASTS if self._reported else Silence.TICKS


class Activity(enum.Enum):
    """What a process does."""

    GOES_ON = enum.auto()  # it computes, or waits for a device, a lock, a disk
    WAITS = enum.auto()  # for a processor; or a debugger holds it
    STOPPED = enum.auto()  # by a signal


class ProcessActivity:
    """Reads from the kernel what the threads of a process do (proc_pid_stat(5))."""

    def __init__(self, pid: int, proc: Path = Path("/proc")) -> None:
        self._folder = proc / str(pid) / "task"
        self._ran: dict[str, str] = {}

    def __call__(self) -> Activity:
        """What it does now; waiting is that a thread could run and has not since the last call."""
        before, self._ran = self._ran, {}
        states, waits = set(), False
        try:
            for thread in self._folder.iterdir():
                state = (thread / "stat").read_text().rpartition(")")[2].split()[0]
                ran = self._ran[thread.name] = (thread / "schedstat").read_text().split()[0]
                states.add(state)
                waits |= state == "R" and before.get(thread.name) == ran
        except OSError:  # a thread has ended, or the kernel has no such files
            return Activity.GOES_ON
        if "T" in states:
            return Activity.STOPPED
        return Activity.WAITS if waits or "t" in states else Activity.GOES_ON
