"""Interrupts the tick of a robot that takes too long, by a timer of the process.

While robots compute, the timer rings `ALARMS` times in the longest time that a tick may take, by the signal
SIGALRM, whose handler (`TickAlarm.ring`) runs in the thread of the tick. There are two ways to find a tick
too long, because Python runs a handler only between two of its own instructions:

* a model in Python, or one that sleeps, lets every alarm through: the handler adds up the time between
  alarms, less that in which the thread waited for a processor, so a busy machine is no fault of a robot;
* a model in one call of C holds the alarms back. They come as one when it returns, and the processor time of
  the thread since the last alarm shows how long it computed.

The handler then raises `UnansweredError` in the middle of the model; the tick of that robot ends there.
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
#: Alarms in the longest tick.
ALARMS: Final = 4
#: Counted intervals that are too many. The first alarm of a tick only begins the count, somewhere in an
#: interval, and the others are counted within half an interval: of 4, more than 2.5.
_MOST_INTERVALS: Final = ALARMS - 1.5
#: Between two alarms this many intervals count at most: a process that a signal had stopped gets one alarm
#: for the whole time.
_INTERVALS_PER_ALARM: Final = 2.0
#: In `TickCosts.running`: no robot computes.
_NONE: Final = -1


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
        self._watched = 0  # parts that ask models and have begun: one may be inside another
        # At the last alarm: which tick ran, the time, the waits so far, and what was counted of that tick.
        self._begun = -1
        self._alarm_s = self._waited_s = self._counted_s = 0.0
        # At the last alarm or start of the timer: the processor time of the thread.
        self._worked_s = 0.0

    def install(self) -> None:
        """Watch the ticks from now on."""
        signal.signal(signal.SIGALRM, self.ring)
        self._costs.watch = self._set_timer

    def _set_timer(self, begins: bool) -> None:
        """Start or stop the timer: it would also end a sleep or a system call of a bus in the same thread."""
        self._watched += 1 if begins else -1
        if self._watched > (1 if begins else 0):
            return
        interval_s = self._interval_s if begins else 0.0
        self._worked_s = time.thread_time()
        signal.setitimer(signal.ITIMER_REAL, interval_s, interval_s)

    def ring(self, _signal: int, _frame: FrameType | None) -> None:
        """Count the time of the tick that runs.

        Raises:
            UnansweredError: it has taken too long.
        """
        costs = self._costs
        is_long_in_c = self._computed() > self._longest_s
        if costs.running == _NONE:
            return
        is_long_in_python = self._counted() > _MOST_INTERVALS * self._interval_s
        if is_long_in_python or is_long_in_c:
            costs.running = _NONE
            raise UnansweredError(f"its model was interrupted after {self._longest_s * 1e3:.0f} ms")

    def _counted(self) -> float:
        """Time of this tick between its alarms so far [s], without waits for a processor."""
        now_s, waited_s = self._costs.now(), self._processor_wait()
        if self._costs.begun == self._begun:
            own_s = now_s - self._alarm_s - (waited_s - self._waited_s)
            self._counted_s += min(max(own_s, 0.0), _INTERVALS_PER_ALARM * self._interval_s)
        else:
            self._begun, self._counted_s = self._costs.begun, 0.0
        self._alarm_s, self._waited_s = now_s, waited_s
        return self._counted_s

    def _computed(self) -> float:
        """Processor time of the thread since the last alarm [s]."""
        before_s, self._worked_s = self._worked_s, time.thread_time()
        return self._worked_s - before_s
