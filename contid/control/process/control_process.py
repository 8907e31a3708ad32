"""The control process: owns the buses and runs the tick; stops the robots when the daemon is gone.

The daemon starts it as ``python -m contid.control.process FD PID`` with the read end of the pipe and its own
process id. It waits for a `RunSetup`, opens the buses and runs a cycle at every deadline of
`contid.control.process.pace`. When the pipe closes, the parent's death is signalled, or the daemon stands
still, so that no stop would get through, every robot stops by its ``on_host_loss`` policy.
"""

from __future__ import annotations

import gc
import logging
import math
import signal
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Final

from contid.control.engine.cycle import RealClock
from contid.control.engine.engine import Engine
from contid.control.engine.events.buses import BusReported
from contid.control.engine.events.robots import RobotReported
from contid.control.engine.events.run import LogWritten, NoteWritten, RunFailed, RunStarted
from contid.control.engine.messages import Finish, Start
from contid.control.engine.ports import BusPort, BusTrackers
from contid.control.engine.report import robot_reports
from contid.control.engine.wiring import build_robot_configs, chains_of, clearance_of, open_buses
from contid.control.process.isolation.model_port import ModelPort
from contid.control.process.isolation.model_ports import begin_ticks, model_ports
from contid.control.process.isolation.port import IsolatedPort, isolated_ports
from contid.control.process.log_queue import LogQueue, handle_logs
from contid.control.process.pace import Pace, PlannedStart
from contid.control.process.pipe import Inbox, RunSetup
from contid.control.process.realtime import disable_gc, request_real_time, sleep_until, warm_up
from contid.control.process.ring_writer import RingWriter
from contid.control.process.skip_cause import SkipCause
from contid.control.process.tick_alarm import ProcessorWait, TickAlarm
from contid.errors import ContidError
from contid.hal import CountsAnswers
from contid.robot_file.tick_rate import watchdog_s

#: Most log records published after one tick; the others wait for the next.
LOGS_PER_TICK: Final = 8

log = logging.getLogger(__name__)

#: Ticks for this time without a look of the daemon at the ring: it stands still [s]. It looks every 20 ms.
STANDS_S: Final = 3.0
#: Longest stop after the daemon is gone.
ORPHAN_STOP_S: Final = 2.0
#: Ticks between two samples of what the robots cost; no divisor of usual distances of rows.
COST_TICKS: Final = 7
#: Share of the time of a watchdog that a period of the ticks may have while they do not fit.
WATCHDOG_SHARE: Final = 0.25
#: Longest wait for a bus to close.
CLOSE_TIMEOUT_S: Final = 0.5


class DaemonGoneError(BaseException):
    """The daemon is gone and nothing is armed; no `SystemExit`, which may be a defect of a driver."""


class ParentWatch:
    """Detects the end of the daemon by its pipe and by the parent-death signal, and one that stands still.

    Attributes:
        opens: buses are opened, and nothing is armed. Before, `parent_gone` is looked at; later the engine
            stops the robots when the daemon is gone.
    """

    def __init__(self, inbox: Inbox) -> None:
        self.opens = False
        self._inbox = inbox
        self._signalled = self._stands = False
        self._looks = self._ticks = 0

    @property
    def parent_gone(self) -> bool:
        """True when the daemon is gone, or stood still for too long."""
        return self._signalled or self._inbox.closed or self._stands

    def count(self, looks: int, rate_hz: float) -> None:
        """Count a tick with the number of the daemon's looks; a machine that stands still makes no ticks."""
        self._looks, self._ticks = looks, self._ticks + 1 if looks == self._looks else 0
        if self._ticks > STANDS_S * rate_hz and not self._stands:
            self._stands = True
            log.error("the daemon stood still for %g s: no stop would get through, robots stop", STANDS_S)

    def signalled(self, _signal: int, _frame: FrameType | None) -> None:
        """Handler of the parent-death signal."""
        self._signalled = True
        if self.opens:
            self.opens = False
            raise DaemonGoneError  # stop waiting for a bus to open


class ControlProcess:
    """The loop around the engine."""

    def __init__(
        self,
        setup: RunSetup,
        inbox: Inbox,
        parent_watch: ParentWatch,
        ring: RingWriter,
        ports: dict[str, BusPort],
        models: Sequence[ModelPort],
        logs: LogQueue,
    ) -> None:
        self._clock = RealClock()
        self._inbox = inbox
        self._parent_watch = parent_watch
        self._ring = ring
        self._setup = setup
        self._logs = logs
        self._ports = ports
        self._models = models
        self._trackers = BusTrackers(port.bus for port in ports.values())
        self.engine = Engine(
            build_robot_configs(setup.loaded, setup.rate_hz), ports, setup.rate_hz, ring, self._clock.now,
            trajectory=setup.trajectory, on_end=setup.on_end, attended=setup.attended,
            chains=chains_of(setup.loaded), clearance=clearance_of(setup.loaded),
        )  # fmt: skip
        self.engine.costs.robot_at_work = ring.robot_at_work
        begin_ticks(models, self.engine.costs, setup.rate_hz)

    def run(self) -> None:
        """Run cycles until every robot is at rest."""
        engine = self.engine
        if self._setup.armed:
            engine.arm()
        else:
            engine.connect()
        processor_wait = ProcessorWait()
        names = [config.name for config in engine.robots.configs]
        cause = SkipCause(engine.costs, names, self._ports, processor_wait)
        costs, watched = engine.costs, [watchdog_s(bus) for bus in self._setup.loaded.buses.values()]
        pace = Pace(
            self._setup.rate_hz, self._clock.now(), self._ring, cause.find,
            lambda: costs.ended_s - costs.began_s,
            WATCHDOG_SHARE * min(filter(None, watched), default=math.inf),
        )  # fmt: skip
        TickAlarm(engine.costs, processor_wait, self._setup.rate_hz).install()
        stop_by_s = math.inf
        planned = PlannedStart(1.0 / self._setup.rate_hz)
        while not engine.finished:
            start_s = sleep_until(pace.deadline_s)
            timing = pace.begin(start_s, engine.preparing)
            cause.begin()
            for message in self._inbox.poll():
                if isinstance(message, LogWritten | NoteWritten):
                    self._ring.event(message)
                elif isinstance(message, Start):
                    planned.plan(message, timing.deadline_s, self._ring)
                else:
                    planned.cancel_for(message)
                    engine.obey(message, timing.tick)
            for measured in self._trackers.arrived(timing.deadline_s):
                engine.obey(measured, timing.tick)
            if (go := planned.due(timing.deadline_s, start_s)) is not None:
                engine.obey(go, timing.tick)
            self._parent_watch.count(self._ring.looks, self._setup.rate_hz)
            if self._parent_watch.parent_gone and stop_by_s == math.inf:
                stop_by_s = start_s + ORPHAN_STOP_S
                engine.obey(Finish(None, "on_host_loss"), timing.tick)
            engine.cycle(timing)
            if timing.tick % COST_TICKS == 0:
                self._ring.publish_costs(engine.costs.robots_s)
                for model in self._models:
                    model.tend()
            self._logs.write(self._ring, LOGS_PER_TICK)
            if start_s > stop_by_s:
                break
        self._ring.event(pace.report())


def main(descriptor: int) -> int:
    """Run the control process; returns its exit code."""
    warm_up()  # in parallel with the daemon reading its files
    inbox = Inbox(descriptor)
    try:
        setup = inbox.wait()
    except EOFError:
        return 0
    assert isinstance(setup, RunSetup)
    parent_watch = ParentWatch(inbox)
    signal.signal(signal.SIGTERM, parent_watch.signalled)  # before, SIGTERM ended this process
    isolated, models = isolated_ports(setup.loaded.buses), model_ports(setup.loaded)
    ring, logs = RingWriter(setup.ring), LogQueue("control")
    try:
        with handle_logs(setup.log_level, logs):
            return _serve(setup, inbox, parent_watch, ring, logs, isolated, models)
    except DaemonGoneError:
        return 0
    finally:
        gc.unfreeze()  # what `disable_gc` froze is collected at the exit: models of the kernels are in cycles
        logs.write(ring)
        ring.finish()
        ring.close()
        if parent_watch.parent_gone:
            with suppress(FileNotFoundError):
                Path(setup.ring).unlink()


def _serve(
    setup: RunSetup,
    inbox: Inbox,
    parent_watch: ParentWatch,
    ring: RingWriter,
    logs: LogQueue,
    isolated: Mapping[str, IsolatedPort],
    models: Sequence[ModelPort] = (),
) -> int:
    """Open the buses, run, close them."""
    ports: dict[str, BusPort] = {**isolated}
    try:
        parent_watch.opens = True
        if parent_watch.parent_gone:
            return 0
        for each in isolated.values():
            each.begin_opening()
        buses = open_buses(setup.loaded, RealClock())
        # To be closed if an isolated one does not open.
        ports |= {name: BusPort(bus, threaded=False) for name, bus in buses.items()}
        for each in isolated.values():
            each.finish_opening()
        for model in models:
            model.finish_building()
        log.debug("open: %s", ", ".join([*isolated, *buses]))
        logs.write(ring)
        why_not = request_real_time()
        ports |= {
            name: BusPort(
                bus, threaded=len(buses) + len(isolated) > 1, reopen_aside=True, prepare=ring.mark_preparing
            )
            for name, bus in buses.items()
        }
        process = ControlProcess(setup, inbox, parent_watch, ring, ports, models, logs)
        parent_watch.opens = False  # first: a run that has started ends with its report
        ring.event(RunStarted(realtime=not why_not, message=why_not))
        disable_gc()
        try:
            process.run()
        except BaseException:
            process.engine.costs.running = -1  # an error in a tick leaves its alarm on
            process.engine.exchange.abandon()
            raise
        for name, fields in robot_reports(process.engine).items():
            ring.event(RobotReported(robot=name, report=fields))
        for name, port in ports.items():
            if isinstance(port.bus, CountsAnswers):
                with _logged(name):
                    ring.event(BusReported(bus=name, counts=dict(port.bus.answer_counts())))
    except ContidError as error:
        ring.event(RunFailed(message=str(error), exit_code=error.exit_code))
        return error.exit_code
    finally:
        parent_watch.opens = False
        for name, port in ports.items():
            with _logged(name):
                port.close(CLOSE_TIMEOUT_S)
        for model in models:
            model.close()
    return 0


@contextmanager
def _logged(bus: str) -> Iterator[None]:
    """Log a defect of the driver of a bus at its end; the others end as ever."""
    try:
        yield
    except Exception as error:
        log.warning("%s: %s: %s", bus, type(error).__name__, error)
