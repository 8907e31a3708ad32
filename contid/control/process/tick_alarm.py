"""Interrupts the tick of a robot that takes too long: a timer of the process, started for the ticks.

A model in Python, or one that sleeps, is interrupted at once; one in C when it returns. The time in which the
process waited for a processor does not count, so a busy machine is no fault of a robot.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from types import FrameType
from typing import Final

from contid.control.engine.tick_costs import TickCosts, UnansweredError

#: Longest tick of one robot: three periods, and at least this time [s].
LONGEST_S: Final = 0.1
LONGEST_PERIODS: Final = 3.0
#: Alarms until then; the first one only begins to count, so a tick is interrupted at least one later.
ALARMS: Final = 4


class ProcessorWait:
    """How long the calling thread has waited for a processor so far [s] (proc_pid_schedstat)."""

    def __init__(self) -> None:
        try:
            self._file = os.open("/proc/thread-self/schedstat", os.O_RDONLY)
        except OSError:  # a kernel without CONFIG_SCHED_INFO: no waiting is known
            self._file = -1

    def __call__(self) -> float:
        """The time since the thread began."""
        return int(os.pread(self._file, 64, 0).split()[1]) * 1e-9 if self._file >= 0 else 0.0


class TickAlarm:
    """The alarm of one run; to be made in the thread of the tick."""

    def __init__(self, costs: TickCosts, processor_wait: Callable[[], float], rate_hz: float) -> None:
        self._costs = costs
        self._processor_wait = processor_wait
        self._longest_s = max(LONGEST_S, LONGEST_PERIODS / rate_hz)
        self._interval_s = self._longest_s / ALARMS
        self._begun = -1
        self._looked_s = self._waited_s = self._counted_s = self._worked_s = 0.0

    def install(self) -> None:
        """Watch the ticks from now on."""
        signal.signal(signal.SIGALRM, self.ring)
        self._costs.watch = self._wind

    def _wind(self, begins: bool) -> None:
        """Start or stop the timer: it would also end a sleep or a system call of a bus in the same thread."""
        interval_s = self._interval_s if begins else 0.0
        self._worked_s = time.thread_time()
        signal.setitimer(signal.ITIMER_REAL, interval_s, interval_s)

    def ring(self, _signal: int, _frame: FrameType | None) -> None:
        """Count the time of the tick that runs.

        Raises:
            UnansweredError: it has taken too long.
        """
        costs = self._costs
        if costs.running < 0:
            return
        now_s, waited_s, before_s = costs.now(), self._processor_wait(), self._worked_s
        self._worked_s = time.thread_time()
        if costs.begun == self._begun:
            own_s = now_s - self._looked_s - (waited_s - self._waited_s)
            # A process that was stopped by a signal gets one alarm only.
            self._counted_s += min(max(own_s, 0.0), 2.0 * self._interval_s)
        else:
            self._begun, self._counted_s = costs.begun, 0.0
        self._looked_s, self._waited_s = now_s, waited_s
        # The alarms during one call in C are one, when it returns; what it computed is the thread's time.
        in_c = self._worked_s - before_s > self._longest_s
        if in_c or self._counted_s > (ALARMS - 1.5) * self._interval_s:
            costs.running = -1
            raise UnansweredError(f"its model was interrupted after {self._longest_s * 1e3:.0f} ms")
