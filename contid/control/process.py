"""The control process: owns the buses and the tick, and outlives the daemon just long enough to stop safely.

Started by the daemon as ``python -m contid.control FD PID``: the reading end of the pipe and the daemon's
process id. It waits for a `Setup`, opens the buses, and then runs a cycle at every deadline

    deadline(n) = base + n / rate        on CLOCK_MONOTONIC,

sleeping to 250 us before it and spinning the rest. A deadline that passed a whole period ago is skipped and
counted, never caught up; while nothing moves the grid is moved instead, because connecting and arming take
their time and harm nobody. When the pipe ends or the parent's death is signalled, every robot is stopped by
its ``on_host_loss`` policy.
"""

from __future__ import annotations

import signal
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Final

from contid.control.clock import RealClock
from contid.control.cycle import Timing
from contid.control.engine import Engine
from contid.control.messages import Finish, Inbox
from contid.control.ports import Port
from contid.control.report import robot_reports
from contid.control.ring import RingWriter
from contid.control.setup import (
    Setup,
    ask_for_real_time,
    sleep_until,
    stop_collecting,
    warm_up,
)
from contid.control.statistics import Lateness
from contid.control.wiring import build_plans, chain_guards, open_buses
from contid.errors import ContidError

#: How long a stop may take once the daemon is gone, and how long a hanging bus is waited for.
ORPHAN_S: Final = 2.0
CLOSE_S: Final = 0.5
#: Share of the period that a tick may start late before it counts as late.
LATE: Final = 0.1
#: Share of the period that a bus with its own worker may take.
BUS_SHARE: Final = 0.9
#: At most one message about skipped ticks in so many seconds.
QUIET_S: Final = 1.0


class ControlProcess:
    """The loop around the engine."""

    def __init__(self, setup: Setup, inbox: Inbox, ring: RingWriter, ports: dict[str, Port]) -> None:
        self._clock = RealClock()
        self._inbox = inbox
        self._ring = ring
        self._period_s = 1.0 / setup.rate_hz
        self._rate_hz = setup.rate_hz
        self._armed = setup.armed
        plans = build_plans(setup.loaded, setup.rate_hz)
        self.engine = Engine(
            plans, ports, setup.rate_hz, ring, self._clock.now,
            trajectory=setup.trajectory, on_end=setup.on_end, attended=setup.attended,
            guards=chain_guards(setup.loaded),
        )  # fmt: skip
        self.orphaned = False
        self._lateness = Lateness()
        self._ticks = self._late = self._skipped = self._waited = 0
        self._told_s = 0.0
        self._untold = 0

    def run(self) -> None:
        """Cycle until every robot rests."""
        if self._armed:
            self.engine.arm()
        else:
            self.engine.connect()
        now, period_s = self._clock.now, self._period_s
        base_s = now() + 2.0 * period_s
        tick, stop_by_s, orphaned = 0, 0.0, False
        while not self.engine.finished:
            deadline_s = base_s + tick * period_s
            start_s = sleep_until(deadline_s)
            waited_s = start_s - deadline_s
            if waited_s >= period_s:
                missed = int((start_s - deadline_s) / period_s)
                if self.engine.moving:
                    tick += missed
                    self._skip(missed, start_s)
                else:
                    base_s += missed * period_s
                    self._waited += missed
                    waited_s -= missed * period_s
                deadline_s = base_s + tick * period_s
            lateness_s = max(start_s - deadline_s, 0.0)
            # The histogram keeps the whole delay, also the part that is told as skipped ticks.
            self._lateness.add(max(waited_s, 0.0))
            self._ticks += 1
            self._late += lateness_s > LATE * period_s
            for message in self._inbox.poll():
                self.engine.obey(message, tick)
            if (self._inbox.closed or self.orphaned) and not orphaned:
                orphaned, stop_by_s = True, start_s + ORPHAN_S
                self.engine.obey(Finish(None, "on_host_loss"), tick)
            self.engine.cycle(
                Timing(
                    tick,
                    self._skipped,
                    deadline_s,
                    lateness_s,
                    deadline_s + BUS_SHARE * period_s,
                )
            )
            tick += 1
            if orphaned and start_s > stop_by_s:
                break
        self._ring.event(
            "report", ticks=self._ticks, late=self._late, skipped=self._skipped, waited=self._waited,
            lateness=self._lateness.as_dict(),
        )  # fmt: skip

    def _skip(self, missed: int, now_s: float) -> None:
        """Count skipped ticks; tell at most once a second."""
        self._skipped += missed
        self._untold += missed
        if now_s - self._told_s >= QUIET_S:
            self._ring.event("skipped", ticks=self._untold, total=self._skipped)
            self._told_s, self._untold = now_s, 0


def main(descriptor: int) -> int:
    """Run the control process; returns its exit code."""
    running: list[ControlProcess] = []
    gone = [False]

    def orphan(_signal: int, _frame: FrameType | None) -> None:
        gone[0] = True
        for process in running:
            process.orphaned = True
        if not running:
            raise SystemExit(0)  # nothing is armed; whoever opens a bus that does not answer stops waiting

    warm_up()  # while the daemon still reads its files
    inbox = Inbox(descriptor)
    try:
        setup = inbox.wait()
    except EOFError:
        return 0
    assert isinstance(setup, Setup)
    signal.signal(signal.SIGTERM, orphan)  # until here it just ended this process
    ring = RingWriter(setup.ring)
    ports: dict[str, Port] = {}
    code = 0
    try:
        buses = open_buses(setup.loaded, RealClock())
        why_not = ask_for_real_time()
        ring.event("started", realtime=not why_not, words=why_not)
        ports |= {name: Port(bus, threaded=len(buses) > 1, reopen_aside=True) for name, bus in buses.items()}
        process = ControlProcess(setup, inbox, ring, ports)
        running.append(process)
        stop_collecting()
        try:
            process.run()
        except BaseException:
            process.engine.abandon()
            raise
        for name, told in robot_reports(process.engine).items():
            ring.event("robot", robot=name, told=told)
    except ContidError as error:
        code = error.exit_code
        ring.event("failed", words=str(error), exit_code=code)
    finally:
        for port in ports.values():
            port.close(CLOSE_S)
        ring.finish()
        ring.close()
        if inbox.closed or gone[0]:
            with suppress(FileNotFoundError):
                Path(setup.ring).unlink()
    return code
