"""What made the loop skip ticks: a model, a bus, rows, a driver that holds the interpreter, or the machine.

A machine that lowers the clock of its processors, for heat or power or because it is a virtual one whose host
does, makes everything slow at once, and no waiting shows it: a loop of known length does.

Of the time between two cycles it has, beside the parts of the cycle (`TickCosts`), how long the thread ran,
how long it waited for a processor (schedstat), and how long it slept and waited for buses as planned. What is
left is time in which the thread could have run and did not: where the worker of a bus had a job for at least
half of that, its driver held the interpreter.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from contid.control.engine.ports import BusPort
from contid.control.engine.tick_costs import TickCosts

#: Passes of the loop that shows the speed of the processor: a few microseconds.
PASSES: Final = 200
#: Share of its speed below which the processor is the cause.
SLOW: Final = 0.4


class ProcessorSpeed:
    """The speed of the processor now, as a share of the greatest that was seen."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now, self._least_s = now, math.inf

    def __call__(self) -> float:
        """Measure it."""
        begin_s = self._now()
        for _ in range(PASSES):
            pass
        took_s = self._now() - begin_s
        self._least_s = min(self._least_s, took_s)
        return self._least_s / took_s


class SkipCause:
    """Looks for the cause after every cycle that ticks were skipped behind."""

    def __init__(
        self,
        costs: TickCosts,
        robots: Sequence[str],
        ports: Mapping[str, BusPort],
        processor_wait: Callable[[], float],
        ran: Callable[[], float] = time.thread_time,
        speed: Callable[[], float] | None = None,
    ) -> None:
        """Prepare.

        Args:
            costs: of the engine.
            robots: their names.
            ports: by bus.
            processor_wait: how long the thread has waited for a processor [s].
            ran: how long it has run [s].
            speed: of the processor, as a share; that of a `ProcessorSpeed` if None.
        """
        self._costs = costs
        self._robots = tuple(robots)
        self._ports = ports
        self._processor_wait = processor_wait
        self._ran = ran
        self._speed = speed or ProcessorSpeed()
        self._began_s = self._waited_s = self._ran_s = 0.0
        self._speed_before = 1.0

    def begin(self) -> None:
        """A cycle begins, with its rows and orders."""
        self._began_s, self._speed_before = self._costs.now(), self._speed()
        self._waited_s, self._ran_s = self._processor_wait(), self._ran()

    def find(self, start_s: float, due_s: float) -> str:
        """The cause, for a person.

        Args:
            start_s: when the cycle starts, after the one that took too long.
            due_s: when it should have started.
        """
        costs = self._costs
        lost_s = start_s - due_s
        waited_s = self._processor_wait() - self._waited_s
        if waited_s > 0.5 * lost_s:
            return f"the machine is busy: contid waited {waited_s * 1e3:.0f} ms for a processor"
        if (speed := min(self._speed_before, self._speed())) < SLOW:
            return f"the machine: its processor ran at {100.0 * speed:.0f} % of its speed"
        planned_s = max(due_s - costs.ended_s, 0.0) + costs.waited_s + sum(costs.buses_s.values())
        held_s = start_s - self._began_s - planned_s - waited_s - (self._ran() - self._ran_s)
        if held_s > 0.5 * lost_s:
            jobs = {name: port.job_s(start_s) for name, port in self._ports.items()}
            longest = max(jobs, key=lambda name: jobs[name], default="")
            if longest and jobs[longest] > 0.5 * held_s:
                return f"bus {longest}: its driver held the interpreter for {held_s * 1e3:.0f} ms"
        parts = {
            f"robot {name}: its model": took for name, took in zip(self._robots, costs.robots_s, strict=True)
        }
        parts |= {f"bus {name}: its exchange": took for name, took in costs.buses_s.items()}
        rest_s = costs.ended_s - costs.began_s - costs.waited_s - sum(parts.values())
        parts["rows and orders"] = costs.began_s - self._began_s
        parts["the machine: a late wake-up"] = start_s - max(due_s, costs.ended_s)
        parts["the loop itself"] = rest_s
        what = max(parts, key=lambda part: parts[part])
        return f"{what} took {parts[what] * 1e3:.0f} ms"
