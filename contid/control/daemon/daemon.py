"""The daemon: supervises one run of the control process; its delays do not affect the tick.

It is the `RunControl` of every source of commands: signals and the stream on stdin here, the socket of
`contid.remote`. Every `POLL_S` it passes the events of the ring to the report, the terminal, the service
manager and the listeners.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

from contid.control.daemon import terminal
from contid.control.daemon.control_child import ControlChild
from contid.control.daemon.inputs import InputCancelledError, Stream
from contid.control.daemon.interfaces import CommandTasks, RunObserver
from contid.control.daemon.notify import Notifier
from contid.control.daemon.order_channel import OrderChannel
from contid.control.daemon.pending_input import PendingInput
from contid.control.daemon.report_builder import ReportBuilder
from contid.control.daemon.responsive import responsive
from contid.control.daemon.ring_feed import RingFeed
from contid.control.daemon.row_stream import LiveRowReader, StreamFollower
from contid.control.daemon.run_request import RunOptions, preflight_of, rate_of
from contid.control.daemon.shutdown import Escalation, RunSignals, ShutdownSequence
from contid.control.daemon.silence_watch import ProcessActivity, Silence, SilenceWatch
from contid.control.engine.cycle import OnEnd
from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import ControlStalled, PaceReported
from contid.control.engine.events.run import NoteWritten, RunFailed, SourceEnded, StopBegan
from contid.control.engine.messages import Begin, EndOfRows, Estop, Finish, Hold, Message
from contid.control.engine.report import RunReport, outrun
from contid.control.engine.tick_layout import RecordLayout, TickRecord
from contid.control.engine.wiring import record_layout
from contid.control.process.isolation.body import isolated
from contid.control.process.isolation.model_threads import MeasuredTipsBeside, ModelThreads
from contid.control.process.log_queue import LogQueue, handle_logs
from contid.control.process.pipe import RunSetup
from contid.control.process.ring_reader import RingReader
from contid.robot_file.load import LoadedFile
from contid.trajectory.timed import Trajectory

#: Interval between reads of the ring.
POLL_S: Final = 0.02
#: A pending input is reported on the terminal after this time.
REPORT_WAITING_S: Final = 3.0

log = logging.getLogger(__name__)


class Daemon:
    """One run; implements `contid.control.daemon.interfaces.RunControl`."""

    def __init__(
        self,
        loaded: LoadedFile,
        source: PendingInput | Trajectory | Stream | None,
        options: RunOptions,
        child: ControlChild,
    ) -> None:
        self.loaded = loaded
        self.rate_hz = rate_of(options, loaded)
        self.unreachable = options.unreachable
        self.input_active = source is not None
        self._source = None if isinstance(source, PendingInput) else source
        self._rows: LiveRowReader | None = None
        self._options = options
        self._child = child
        self._report = ReportBuilder(self.rate_hz)
        self._models = ModelThreads(loaded)
        self._tips = MeasuredTipsBeside(loaded, self.rate_hz, self._models)
        self._shutdown = ShutdownSequence()
        self._silence = SilenceWatch(self.rate_hz, ProcessActivity(child.pid))
        self._ended = False
        self._notifier = Notifier()
        self._logs = LogQueue("daemon")
        # The recording holds records from INFO also when the terminal shows warnings only.
        self._recorded_level = min(options.log_level, logging.INFO)
        self._feed = RingFeed(child, self._report, options)
        self._feed.listen(self._on_event)
        pending = source if isinstance(source, PendingInput) else None
        self._orders = OrderChannel(
            child, pending, options.observers, self._report, self._feed.deliver, self._logs
        )
        self._tasks = CommandTasks(self._source_failed)
        self._attached: list[RunObserver] = []
        self._signals = RunSignals(self.interrupt, self.hung_up)

    # -- orders ------------------------------------------------------------------------------------------

    @property
    def waiting(self) -> str:
        """See `RunControl.waiting`."""
        return self._orders.pending.message if self._orders.pending is not None else ""

    def send(self, message: Message) -> None:
        """See `RunControl.send`."""
        self._orders.send(message)

    def note(self, event: NoteWritten) -> None:
        """See `RunControl.note`."""
        self._orders.note(event)

    def newest(self) -> TickRecord | None:
        """See `RunControl.newest`."""
        return self._child.reader.newest() if self._child.reader else None

    def record_of(self, tick: int) -> TickRecord | None:
        """See `RunControl.record_of`."""
        return self._child.reader.record_of(tick) if self._child.reader else None

    def lateness(self, ticks: int) -> list[float]:
        """See `RunControl.lateness`."""
        return self._child.reader.lateness(ticks) if self._child.reader else []

    def costs(self) -> list[float]:
        """See `RunControl.costs`."""
        return self._child.reader.costs_s if self._child.reader else []

    def refresh(self) -> None:
        """See `RunControl.refresh`; without effect when called by a listener."""
        if not self._feed.fetching:
            self._feed.fetch()

    def listen(self, listener: Callable[[RunEvent], None]) -> None:
        """See `RunControl.listen`."""
        self._feed.listen(listener)

    def detach_input(self) -> None:
        """See `RunControl.detach_input`."""
        self.input_active = False
        self.send(Hold())
        if self._orders.pending is not None:
            self._orders.pending.cancel()
            return
        self.send(Begin())

    def interrupt(self) -> None:
        """See `RunControl.interrupt`."""
        self._shutdown.requests += 1
        self._report.interrupted()
        if self._orders.pending is not None:
            self._orders.pending.cancel()
        elif self._shutdown.requests == 1:
            log.info("Stopping. Press Ctrl-C again to cut torque now.")
            self.send(Finish())
            self._shutdown.stop(asyncio.get_running_loop().time())
            if not self._report.started:
                # Opening the buses takes long when no device answers, and no order is read meanwhile.
                self._child.terminate()
        else:
            log.info("Relaxing now.")
            self._relax()

    def hung_up(self) -> None:
        """The terminal was closed, or Ctrl-Z: an orderly stop. Shells send SIGHUP twice; one is enough."""
        if not self._shutdown.requests:
            self.interrupt()

    def _relax(self) -> None:
        self.send(Estop())
        self.send(Finish())
        self._shutdown.relax(asyncio.get_running_loop().time())

    # -- the run -----------------------------------------------------------------------------------------

    async def run(self) -> RunReport:
        """Run to the end and report; the control process has ended on return."""
        with handle_logs(self._recorded_level, self._logs, terminal.TerminalHandler(self._options.log_level)):
            return await self._run()

    async def _run(self) -> RunReport:
        layout = record_layout(self.loaded, self.rate_hz)
        ring = self._child.create_ring(layout)
        line = terminal.ProgressLine(layout, self._options.log_level)
        try:
            self._signals.handle()
            for commands in self._options.commands:
                self._tasks.start(commands.serve(self))
            not_stopped = await self._read_pending()
            if not self._shutdown.requests:
                with responsive():
                    self._begin(ring, layout, armed=self._options.armed and not_stopped)
                    await self._supervise(line)
        finally:
            self._signals.ignore()
            await self._tasks.end()
            self._conclude(line)
            self._child.close()
            self._signals.remove()
            for observer in self._attached:
                with suppress(Exception, KeyboardInterrupt):
                    self._report.report.problems += observer.detach()
            self._feed.end_log()
        return self._report.report

    async def _read_pending(self) -> bool:
        """Wait for the input; False when the robots were stopped or the input was detached meanwhile.

        Raises:
            ContidError: it is wrong or empty; no device was opened.
        """
        pending = self._orders.pending
        if pending is None:
            return True
        reminder = asyncio.get_running_loop().call_later(REPORT_WAITING_S, log.info, pending.message)
        try:
            self._source = await pending.result()
        except InputCancelledError:
            return False
        finally:
            reminder.cancel()
        return not pending.stopped

    def _begin(self, ring: Path, layout: RecordLayout, armed: bool) -> None:
        """Attach the observers and start the control process."""
        options, source = self._options, self._source
        self._feed.begin_log(layout)
        setup = RunSetup(
            self.loaded,
            self.rate_hz,
            ring,
            trajectory=source if isinstance(source, Trajectory) else None,
            on_end=options.on_end,
            # A run with an input ends with it, or when every robot is in FAULT; others wait for orders.
            attended=source is None or options.on_end is OnEnd.HOLD or not armed,
            armed=armed,
            log_level=self._recorded_level,
        )
        for observer in options.observers:
            observer.attach(setup, self._child.pid)
            self._attached.append(observer)
        self._child.start(replace(setup, loaded=isolated(self.loaded)))
        log.debug("control process %d writes %s", self._child.pid, ring)
        self._orders.pending = None
        if isinstance(source, Stream):
            self._tasks.start(self._follow(source))

    async def _follow(self, stream: Stream) -> None:
        call, robots = self._models.call, self.loaded.driven
        preflight = await call(robots, preflight_of, self._options, self.loaded)
        self._rows = reader = LiveRowReader(stream, preflight)

        async def read(line: str, number: int) -> Message | None:
            # Of an input that was detached no model is asked, and nothing is reported.
            return await call(robots, reader.row, line, number) if self.input_active else None

        await StreamFollower(stream, read, self._send_input).follow()
        self._send_input(EndOfRows())

    def _send_input(self, message: Message) -> None:
        """Send a row of the stream on stdin, unless the input was detached."""
        if self.input_active:
            self._orders.send(message)

    async def _supervise(self, line: terminal.ProgressLine) -> None:
        """Fetch events until the control process has ended; escalate when it does not stop in time."""
        loop = asyncio.get_running_loop()
        end_s = self._source.end_s if isinstance(self._source, Trajectory) else None
        while self._child.status is None:
            await asyncio.sleep(POLL_S)
            self._orders.forward_logs()
            self._child.flush()
            self._feed.fetch()
            if self._child.reader is not None:
                self._child.reader.note_look()
                self._notifier.ticked(self._child.reader.written, loop.time())
                if self._stands_still(self._child.reader, loop.time()):
                    break
            match self._shutdown.due(loop.time()):
                case Escalation.RELAX:
                    self._report.problem("the orderly stop took too long; relaxed at once")
                    self._relax()
                case Escalation.KILL:
                    self._child.kill()
                    self._report.killed()
                    break
            self._tips.add(self.newest())
            line.show(self.newest, end_s)

    def _stands_still(self, reader: RingReader, now_s: float) -> bool:
        """Report when the control process stands still; True when it has been killed for it."""
        if self._ended:
            return False
        watch = self._silence
        found = watch.look(reader.written, reader.preparing, now_s)
        where = "" if reader.robot < 0 else f" in the model of {list(self.loaded.driven)[reader.robot]}"
        if found is Silence.KILL:
            log.error(
                f"the control process stands still{where}; it is killed, and the devices stop by themselves"
            )
            self._child.kill()
            self._report.stalled(watch.silent_s, where)
            return True
        if found is Silence.BEGAN:
            log.warning(f"the control process stands still{where}")
        if found in (Silence.BEGAN, Silence.OVER):
            over = found is Silence.OVER
            self._feed.deliver(ControlStalled(silent_s=round(watch.silent_s, 3), over=over))
        return False

    def _on_event(self, event: RunEvent) -> None:
        match event:
            case SourceEnded():
                self.input_active = False
            case StopBegan():
                self._notifier.stopping()
                self._shutdown.stop_takes(event.seconds, asyncio.get_running_loop().time())
            case RunFailed() | PaceReported():
                self._ended = True
                self._notifier.stopping()

    def _source_failed(self, message: str) -> None:
        """End the run: a source of commands has failed."""
        self._report.problem(message)
        log.error(message)
        if not self._shutdown.requests and self._child.status is None:
            self.interrupt()
            self._report.broken(message)

    def _conclude(self, line: terminal.ProgressLine) -> None:
        """Fetch the last events and complete the report."""
        self._feed.fetch()
        line.clear()
        reader = self._child.reader
        assert reader is not None
        missed = self._feed.missed_ticks
        self._report.conclude(reader, self._child.status)
        self._tips.complete(self._report.report.robots)
        if isinstance(self._source, Stream):
            self._report.report.problems += outrun(self._report.report.robots)
        if self._rows is not None:
            self._rows.complete(self._report.report)
        if missed:
            self._report.problem(f"{missed} ticks are missing in the command log")
