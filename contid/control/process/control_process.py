"""The control process: owns the buses and the tick, and outlives the daemon just long enough to stop safely.

Started by the daemon as ``python -m contid.control.process FD PID``: the reading end of the pipe and the
daemon's
process id. It waits for a `RunSetup`, opens the buses, and then runs a cycle at every deadline of
its
`contid.control.process.pace`, sleeping to 250 us before it and spinning the rest. When the pipe ends or
the parent's death is signalled, every robot is stopped by its ``on_host_loss`` policy.
"""

from __future__ import annotations

import math
import signal
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Final

from contid.control.engine.clock import RealClock
from contid.control.engine.engine import Engine
from contid.control.engine.messages import Finish
from contid.control.engine.ports import BusPort
from contid.control.engine.report import robot_reports
from contid.control.engine.wiring import build_robot_configs, chain_guards, open_buses
from contid.control.process.pace import Pace
from contid.control.process.pipe import Inbox
from contid.control.process.realtime import ask_for_real_time, sleep_until, stop_collecting, warm_up
from contid.control.process.ring import RingWriter
from contid.control.process.setup import RunSetup
from contid.errors import ContidError

#: How long a stop may take once the daemon is gone, and how long a hanging bus is waited for.
ORPHAN_S: Final = 2.0
CLOSE_S: Final = 0.5


class ParentWatch:
    """Whether the daemon is still there: its end of the pipe is open, and no signal told of its death.

    Attributes:
        running: the robots are in the hands of the engine, which stops them when the daemon is gone.
    """

    def __init__(self, inbox: Inbox) -> None:
        self.running = False
        self._inbox = inbox
        self._signalled = False

    @property
    def cut(self) -> bool:
        """True when the daemon is gone."""
        return self._signalled or self._inbox.closed

    def signalled(self, _signal: int, _frame: FrameType | None) -> None:
        """Handler of the signal that the death of the daemon sends."""
        self._signalled = True
        if not self.running:
            raise SystemExit(0)  # nothing is armed; whoever opens a bus that does not answer stops waiting


class ControlProcess:
    """The loop around the engine."""

    def __init__(
        self, setup: RunSetup, inbox: Inbox, tether: ParentWatch, ring: RingWriter, ports: dict[str, BusPort]
    ) -> None:
        self._clock = RealClock()
        self._inbox = inbox
        self._tether = tether
        self._ring = ring
        self._setup = setup
        self.engine = Engine(
            build_robot_configs(setup.loaded, setup.rate_hz), ports, setup.rate_hz, ring, self._clock.now,
            trajectory=setup.trajectory, on_end=setup.on_end, attended=setup.attended,
            guards=chain_guards(setup.loaded),
        )  # fmt: skip

    def run(self) -> None:
        """Cycle until every robot rests."""
        engine = self.engine
        if self._setup.armed:
            engine.arm()
        else:
            engine.connect()
        pace = Pace(self._setup.rate_hz, self._clock.now(), self._ring)
        stop_by_s = math.inf
        while not engine.finished:
            start_s = sleep_until(pace.deadline_s)
            timing = pace.begin(start_s, engine.moving)
            for message in self._inbox.poll():
                engine.obey(message, timing.tick)
            if self._tether.cut and stop_by_s == math.inf:
                stop_by_s = start_s + ORPHAN_S
                engine.obey(Finish(None, "on_host_loss"), timing.tick)
            engine.cycle(timing)
            if start_s > stop_by_s:
                break
        self._ring.event("report", **pace.report())


def main(descriptor: int) -> int:
    """Run the control process; returns its exit code."""
    warm_up()  # while the daemon still reads its files
    inbox = Inbox(descriptor)
    try:
        setup = inbox.wait()
    except EOFError:
        return 0
    assert isinstance(setup, RunSetup)
    tether = ParentWatch(inbox)
    signal.signal(signal.SIGTERM, tether.signalled)  # until here it just ended this process
    ring = RingWriter(setup.ring)
    try:
        return _serve(setup, inbox, tether, ring)
    finally:
        ring.finish()
        ring.close()
        if tether.cut:
            with suppress(FileNotFoundError):
                Path(setup.ring).unlink()


def _serve(setup: RunSetup, inbox: Inbox, tether: ParentWatch, ring: RingWriter) -> int:
    """Open the buses, run, let them go."""
    ports: dict[str, BusPort] = {}
    try:
        buses = open_buses(setup.loaded, RealClock())
        why_not = ask_for_real_time()
        ring.event("started", realtime=not why_not, message=why_not)
        ports |= {
            name: BusPort(bus, threaded=len(buses) > 1, reopen_aside=True) for name, bus in buses.items()
        }
        process = ControlProcess(setup, inbox, tether, ring, ports)
        tether.running = True
        stop_collecting()
        try:
            process.run()
        except BaseException:
            process.engine.abandon()
            raise
        for name, told in robot_reports(process.engine).items():
            ring.event("robot", robot=name, told=told)
    except ContidError as error:
        ring.event("failed", message=str(error), exit_code=error.exit_code)
        return error.exit_code
    finally:
        for port in ports.values():
            port.close(CLOSE_S)
    return 0
