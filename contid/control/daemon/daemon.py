"""The daemon: supervises one run of the control process; may be late without anybody noticing.

It is the `Orders` of everybody who commands the run: signals and the stream on stdin here, the socket of
`contid.remote`. Every `POLL_S` it hears the events of the ring and lets everybody know who wants to: the
account, the person at the terminal, the service manager, the listeners.
"""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Coroutine, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from contid.control.daemon import terminal
from contid.control.daemon.cancellable_reader import InputCancelledError
from contid.control.daemon.control_child import ControlChild
from contid.control.daemon.inputs import Stream
from contid.control.daemon.interfaces import CommandSource, RunObserver
from contid.control.daemon.notify import Notifier
from contid.control.daemon.pending_input import PendingInput
from contid.control.daemon.report_builder import ReportBuilder
from contid.control.daemon.row_stream import LiveRowReader, follow_stream
from contid.control.daemon.shutdown import Escalation, ShutdownSequence
from contid.control.engine.command_log import CommandLog
from contid.control.engine.cycle import OnEnd
from contid.control.engine.messages import Begin, EndOfRows, Estop, Finish, Hold, Message, Play
from contid.control.engine.report import RunReport
from contid.control.engine.tick_layout import RecordLayout, TickRecord
from contid.control.engine.wiring import build_preflight, record_layout
from contid.control.process.setup import RunSetup
from contid.control.tick.preflight import Unreachable
from contid.robot_file.load import LoadedFile
from contid.trajectory.timed import Trajectory

#: How often events are fetched from the ring.
POLL_S: Final = 0.02
#: A person is told what is waited for after so long.
TELL_S: Final = 3.0
#: Ctrl-C, and what a service manager sends.


@dataclass(slots=True)
class RunOptions:
    """How to run.

    Attributes:
        rate_hz: of the tick.
        on_end: what to do when the input ends.
        unreachable: what to do with unreachable rows of a stream.
        log: where to write the command log.
        armed: arm at once; False to wait for `resume`.
        commands: sources of commands beside the input, such as the socket.
        observers: readers of the ring.
        say: takes messages for a person.
    """

    rate_hz: float
    on_end: OnEnd = OnEnd.STOP
    unreachable: Unreachable = Unreachable.REFUSE
    log: Path | None = None
    armed: bool = True
    commands: Sequence[CommandSource] = ()
    observers: Sequence[RunObserver] = ()
    say: Callable[[str], None] = terminal.say


class Daemon:
    """One run; see `contid.control.daemon.interfaces.Orders` for what may be asked of it."""

    def __init__(
        self,
        loaded: LoadedFile,
        source: PendingInput | Trajectory | Stream | None,
        options: RunOptions,
        child: ControlChild,
    ) -> None:
        self.loaded = loaded
        self.rate_hz = options.rate_hz
        self.unreachable = options.unreachable
        self.input_moves = source is not None
        self._awaited = source if isinstance(source, PendingInput) else None
        self._source = None if isinstance(source, PendingInput) else source
        self._options = options
        self._child = child
        self._account = ReportBuilder(options.rate_hz)
        self._ending = ShutdownSequence()
        self._notifier = Notifier()
        self._listeners: list[Callable[[Mapping[str, Any]], None]] = []
        self._attached: list[RunObserver] = []
        self._tasks: list[asyncio.Task[None]] = []
        self._log: CommandLog | None = None
        self._fetching = False
        self._signals = {signal.SIGINT: self.interrupt, signal.SIGTERM: self.interrupt}
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # nohup
            self._signals[signal.SIGHUP] = self.hung_up

    # -- orders ------------------------------------------------------------------------------------------

    @property
    def waiting(self) -> str:
        """See `Orders.waiting`."""
        return self._awaited.message if self._awaited is not None else ""

    def say(self, message: str) -> None:
        """See `Orders.say`."""
        self._options.say(message)

    def send(self, message: Message) -> None:
        """See `Orders.send`."""
        if self._awaited is not None:
            for event in self._awaited.answer(message):
                asyncio.get_running_loop().call_soon(self._hear, event)
            return
        self._tell(message)
        self._child.send(message)

    def send_bulk(self, message: Message) -> None:
        """See `Orders.send_bulk`."""
        if self._awaited is not None:
            self.send(message)
            return
        self._tell(message)
        self._child.send_bulk(message)

    def _tell(self, message: Message) -> None:
        """Let the observers know of a long order before anybody obeys it."""
        if isinstance(message, Play):
            for observer in self._options.observers:
                observer.told(message)

    def newest(self) -> TickRecord | None:
        """See `Orders.newest`."""
        return self._child.reader.newest() if self._child.reader else None

    def lateness(self, ticks: int) -> list[float]:
        """See `Orders.lateness`."""
        return self._child.reader.lateness(ticks) if self._child.reader else []

    def refresh(self) -> None:
        """See `Orders.refresh`; a listener that asks hears of the rest when its turn comes."""
        if not self._fetching:
            self._fetch()

    def listen(self, listener: Callable[[Mapping[str, Any]], None]) -> None:
        """See `Orders.listen`."""
        self._listeners.append(listener)

    def displace_input(self) -> None:
        """See `Orders.displace_input`."""
        self.input_moves = False
        self.send(Hold())
        if self._awaited is not None:
            self._awaited.give_up()
            return
        self.send(Begin())

    def interrupt(self) -> None:
        """See `Orders.interrupt`."""
        self._ending.asked += 1
        self._account.interrupted()
        if self._awaited is not None:
            self._awaited.give_up()
        elif self._ending.asked == 1:
            self.send(Finish())
            self._ending.stop(asyncio.get_running_loop().time())
            if not self._account.started:
                # It opens its buses, long when nobody answers, and looks at no order meanwhile.
                self._child.terminate()
            self.say("stopping; once more to relax at once")
        else:
            self._relax()
            self.say("relaxing now")

    def hung_up(self) -> None:
        """The terminal was closed: an orderly stop. Shells say it twice, which is no wish to relax."""
        if not self._ending.asked:
            self.interrupt()

    def _relax(self) -> None:
        self.send(Estop())
        self.send(Finish())
        self._ending.relax(asyncio.get_running_loop().time())

    # -- the run -----------------------------------------------------------------------------------------

    async def run(self) -> RunReport:
        """Run to the end and report; never leaves the control process behind."""
        layout = record_layout(self.loaded, self.rate_hz)
        ring = self._child.create_ring(layout)
        line = terminal.ProgressLine(layout)
        loop = asyncio.get_running_loop()
        try:
            for number, handler in self._signals.items():
                loop.add_signal_handler(number, handler)
            for commands in self._options.commands:
                self._attend(commands.serve(self))
            undisturbed = await self._input_came()
            if not self._ending.asked:
                self._begin(ring, layout, armed=self._options.armed and undisturbed)
                await self._supervise(line)
        finally:
            for number in self._signals:
                loop.remove_signal_handler(number)
            await self._end_tasks()
            self._conclude(line)
            self._child.close()
            for observer in self._attached:
                with suppress(Exception):
                    self._account.report.problems += observer.detach()
            self._end_log("")
        return self._account.report

    async def _input_came(self) -> bool:
        """Wait for the input; False when somebody stopped or displaced it before it came.

        Raises:
            ContidError: it is wrong, or there is none; nothing was touched.
        """
        awaited = self._awaited
        if awaited is None:
            return True
        telling = asyncio.get_running_loop().call_later(TELL_S, self.say, awaited.message)
        try:
            self._source = await awaited.result()
        except InputCancelledError:
            return False
        finally:
            telling.cancel()
        return not awaited.stopped

    def _begin(self, ring: Path, layout: RecordLayout, armed: bool) -> None:
        """Hand the run over to the control process, and what it records to the observers."""
        options, source = self._options, self._source
        self._log = None if options.log is None else CommandLog(options.log, layout)
        setup = RunSetup(
            self.loaded,
            options.rate_hz,
            ring,
            trajectory=source if isinstance(source, Trajectory) else None,
            on_end=options.on_end,
            # A run with an input ends with it, or with a fault of every robot; others wait for orders.
            attended=source is None or options.on_end is OnEnd.HOLD or not armed,
            armed=armed,
        )
        for observer in options.observers:
            observer.attach(setup, self._child.pid)
            self._attached.append(observer)
        self._child.begin(setup)
        self._awaited = None
        if isinstance(source, Stream):
            self._attend(self._follow(source))

    async def _follow(self, stream: Stream) -> None:
        preflight = build_preflight(self.loaded, self.rate_hz, self.unreachable)
        await follow_stream(stream, LiveRowReader(stream, preflight, self.say), self._send_input)
        self._send_input(EndOfRows())

    def _send_input(self, message: Message) -> None:
        """A row of the stream on stdin, unless somebody took over."""
        if self.input_moves:
            self.send(message)

    async def _supervise(self, line: terminal.ProgressLine) -> None:
        """Fetch events until the control process is gone; press on when it does not stop in time."""
        loop = asyncio.get_running_loop()
        end_s = self._source.end_s if isinstance(self._source, Trajectory) else None
        while self._child.status is None:
            await asyncio.sleep(POLL_S)
            self._child.flush()
            self._fetch()
            if self._child.reader is not None:
                self._notifier.ticked(self._child.reader.written, loop.time())
            match self._ending.due(loop.time()):
                case Escalation.RELAX:
                    self._account.problem("the orderly stop took too long; relaxed at once")
                    self._relax()
                case Escalation.KILL:
                    self._child.kill()
                    self._account.killed()
                    break
            line.show(self.newest, end_s)

    def _fetch(self) -> None:
        reader = self._child.reader
        assert reader is not None
        self._fetching = True
        try:
            for event in reader.events():
                self._hear(event)
        finally:
            self._fetching = False
        if self._log is not None:
            try:
                for record in reader.ticks():
                    self._log.add(record)
            except OSError as error:
                self._end_log(f"{self._options.log}: the log ends here, the run goes on: {error.strerror}")

    def _end_log(self, message: str) -> None:
        """Close the command log, with what went wrong: a full disk is no reason to drop a robot."""
        log, self._log = self._log, None
        if log is not None:
            with suppress(OSError):
                log.close()
        if message:
            self._account.problem(message)
            self.say(message)

    def _hear(self, event: Mapping[str, Any]) -> None:
        """An event of the ring: everybody hears of it."""
        self._account.hear(event)
        if message := terminal.words_of(event):
            self.say(message)
        match event["event"]:
            case "end":
                self.input_moves = False
            case "stopping":
                self._notifier.stopping()
                self._ending.takes(event["seconds"], asyncio.get_running_loop().time())
            case "failed" | "report":
                self._notifier.stopping()
        for listener in self._listeners:
            listener(event)

    def _attend(self, source: Coroutine[Any, Any, None]) -> None:
        """Let a source of commands work beside the run."""
        task = asyncio.create_task(source)
        task.add_done_callback(self._source_ended)
        self._tasks.append(task)

    def _source_ended(self, task: asyncio.Task[None]) -> None:
        """A run that cannot be told to stop any more stops: the socket is how others reach it."""
        died = None if task.cancelled() else task.exception()
        if died is None:
            return
        message = f"a source of commands ended early: {type(died).__name__}: {died}"
        self._account.problem(message)
        self.say(message)
        if not self._ending.asked and self._child.status is None:
            self.interrupt()
            self._account.broken(message)

    async def _end_tasks(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _conclude(self, line: terminal.ProgressLine) -> None:
        """The last events, and what they mean for the report."""
        self._fetch()
        line.clear()
        reader = self._child.reader
        assert reader is not None
        missed = reader.missed_ticks if self._log is not None else 0
        self._account.conclude(reader, self._child.status)
        if missed:
            self._account.problem(f"{missed} ticks are missing in the command log")
