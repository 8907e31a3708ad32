"""The daemon: supervises one run of the control process; may be late without anybody noticing.

Everything it does goes through `Orders`, the one small interface for whoever commands a run: signals and the
stream on stdin here, the socket of `contid.remote`. Observers (recorder, viewer) get the path of the
ring and read at their own pace.
"""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

from contid.control.awaited import Awaited
from contid.control.child import ControlChild
from contid.control.command_log import CommandLog
from contid.control.cycle import OnEnd, Sink
from contid.control.inputs import Stream
from contid.control.messages import Begin, End, Estop, Finish, Hold, Message, Play
from contid.control.notify import Notifier
from contid.control.patience import GivenUpError
from contid.control.preflight import Unreachable
from contid.control.record import TickRecord
from contid.control.report import Report, complete_from_records
from contid.control.setup import Setup
from contid.control.streaming import follow_stream
from contid.control.supervisor import Mode
from contid.control.wiring import build_preflight, record_layout
from contid.description.load import LoadedFile
from contid.trajectory.timed import Trajectory

#: How often events are fetched from the ring.
POLL_S: Final = 0.02
#: How long the control process may take to say how long its stop takes, and how much longer than that it may
#: take; then it relaxes at once, and after `END_S` it is killed. Together less than the 2 s that people wait.
PATIENCE_S: Final = 0.8
END_S: Final = 0.5
#: A person is told what is waited for after so long.
TELL_S: Final = 3.0


def say(words: str) -> None:
    """A message for a person; the line of progress at a terminal makes room for it."""
    clear = "\r\x1b[K" if sys.stderr.isatty() else ""
    sys.stderr.write(f"{clear}contid: {words}\n")
    sys.stderr.flush()


class Orders(Protocol):
    """What a source of commands may do with a run."""

    @property
    def loaded(self) -> LoadedFile:
        """The robot file."""
        ...

    @property
    def options(self) -> RunOptions:
        """How the run was asked for."""
        ...

    @property
    def input_moves(self) -> bool:
        """True while stdin or --trajectory is what the robots follow."""
        ...

    @property
    def waiting(self) -> str:
        """What the run waits for before it begins, "" once it has begun."""
        ...

    def displace_input(self) -> None:
        """Hold, and follow the input of the run no more."""
        ...

    def send(self, message: Message) -> None:
        """Give an order to the control process."""
        ...

    def send_bulk(self, message: Message) -> None:
        """Give a long order, its arrays by way of shared memory: nothing waits behind it."""
        ...

    def newest(self) -> TickRecord | None:
        """The newest record."""
        ...

    def lateness(self, ticks: int) -> list[float]:
        """How late the newest ticks started [s]."""
        ...

    def refresh(self) -> None:
        """Hear of every event up to now at once."""
        ...

    def listen(self, listener: Callable[[Mapping[str, Any]], None]) -> None:
        """Call ``listener`` with every further event."""
        ...

    def interrupt(self) -> None:
        """End the run: orderly the first time, relax or vent now the second."""
        ...


class Commands(Protocol):
    """A source of commands, such as the socket."""

    async def serve(self, orders: Orders) -> None:
        """Take commands until cancelled."""
        ...


class Observer(Protocol):
    """Something that reads the ring, such as a recorder in its own process."""

    def attach(self, setup: Setup, pid: int) -> None:
        """Begin: ``setup`` names the ring, ``pid`` is its writer; called before the first tick.

        Raises:
            ContidError: it cannot; nothing is started then.
        """
        ...

    def follow(self, setup: Setup) -> Sink:
        """The same for a run in virtual time, which has no ring: a sink within this process."""
        ...

    def told(self, message: Message) -> None:
        """An order is about to go to the control process; of a `Play`, events do not hold the content."""
        ...

    def detach(self) -> Sequence[str]:
        """The ring is finished: read the rest and end, within a bounded time.

        Returns:
            What went wrong, in words for the report.
        """
        ...


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
    commands: Sequence[Commands] = ()
    observers: Sequence[Observer] = ()
    say: Callable[[str], None] = say


class Daemon:
    """One run."""

    def __init__(
        self,
        loaded: LoadedFile,
        source: Awaited | Trajectory | Stream | None,
        options: RunOptions,
        child: ControlChild,
    ) -> None:
        self.loaded = loaded
        self._awaited = source if isinstance(source, Awaited) else None
        self._source = None if isinstance(source, Awaited) else source
        self.options = self._options = options
        self.input_moves = source is not None
        self._child = child
        self._listeners: list[Callable[[Mapping[str, Any]], None]] = []
        self._report = Report(ending="the input ended", rate_hz=options.rate_hz)
        self._interrupts = 0
        self._started = False
        self._fetching = False
        self._give_up_s: float | None = None
        self._end_s: float | None = None
        self._last: TickRecord | None = None
        self._log: CommandLog | None = None
        self._terminal = sys.stderr.isatty()
        self._notifier = Notifier()

    # -- orders ------------------------------------------------------------------------------------------

    @property
    def waiting(self) -> str:
        """See `Orders.waiting`."""
        return self._awaited.words if self._awaited is not None else ""

    def send(self, message: Message) -> None:
        """See `Orders.send`."""
        if self._awaited is not None:
            for event in self._awaited.answer(message):
                asyncio.get_running_loop().call_soon(self._hear, event)
            return
        self._tell(message)
        self._child.send(message)

    def _tell(self, message: Message) -> None:
        """Let the observers know of a long order before anybody obeys it."""
        if isinstance(message, Play):
            for observer in self._options.observers:
                observer.told(message)

    def newest(self) -> TickRecord | None:
        """See `Orders.newest`."""
        return self._child.reader.newest() if self._child.reader else None

    def send_bulk(self, message: Message) -> None:
        """See `Orders.send_bulk`."""
        if self._awaited is not None:
            self.send(message)
            return
        self._tell(message)
        self._child.send_bulk(message)

    def refresh(self) -> None:
        """See `Orders.refresh`; a listener that asks hears of the rest when its turn comes."""
        if not self._fetching:
            self._fetch()

    def lateness(self, ticks: int) -> list[float]:
        """See `Orders.lateness`."""
        return self._child.reader.lateness(ticks) if self._child.reader else []

    def displace_input(self) -> None:
        """See `Orders.displace_input`."""
        self.input_moves = False
        self.send(Hold())
        if self._awaited is not None:
            self._awaited.give_up()
            return
        self.send(Begin())

    def _send_input(self, message: Message) -> None:
        """A row of the stream on stdin, unless somebody took over."""
        if self.input_moves:
            self.send(message)

    def listen(self, listener: Callable[[Mapping[str, Any]], None]) -> None:
        """See `Orders.listen`."""
        self._listeners.append(listener)

    def interrupt(self) -> None:
        """See `Orders.interrupt`."""
        self._interrupts += 1
        self._report.ending, self._report.exit_code = "interrupted", 130
        loop = asyncio.get_running_loop()
        if self._awaited is not None:
            self._awaited.give_up()
        elif self._interrupts == 1:
            self._options.say("stopping; once more to relax at once")
            self.send(Finish())
            # Until the control process tells how long the motion takes.
            self._give_up_s = loop.time() + PATIENCE_S
            if not self._started:
                # It opens its buses, long when nobody answers, and looks at no order meanwhile.
                self._child.terminate()
        else:
            self._options.say("relaxing now")
            self._emergency()

    def _emergency(self) -> None:
        self.send(Estop())
        self.send(Finish())
        self._give_up_s = None
        self._end_s = asyncio.get_running_loop().time() + END_S

    # -- the run -----------------------------------------------------------------------------------------

    async def run(self) -> Report:
        """Run to the end and report; never leaves the control process behind."""
        options = self._options
        layout = record_layout(self.loaded, options.rate_hz)
        path = self._child.create_ring(layout)
        tasks: list[asyncio.Task[None]] = []
        attached: list[Observer] = []
        loop = asyncio.get_running_loop()
        try:
            for number in (signal.SIGINT, signal.SIGTERM):
                loop.add_signal_handler(number, self.interrupt)
            tasks += [asyncio.create_task(commands.serve(self)) for commands in options.commands]
            undisturbed = await self._input_came()
            armed = options.armed and undisturbed
            if self._interrupts:
                return self._report
            self._log = None if options.log is None else CommandLog(options.log, layout)
            timed = self._source if isinstance(self._source, Trajectory) else None
            # A run with an input ends with it, or with a fault of every robot; others wait for orders.
            attended = self._source is None or options.on_end is OnEnd.HOLD or not armed
            setup = Setup(self.loaded, options.rate_hz, path, timed, options.on_end, attended, armed)
            for observer in options.observers:
                observer.attach(setup, self._child.pid)
                attached.append(observer)
            self._child.begin(setup)
            self._awaited = None
            if isinstance(self._source, Stream):
                tasks.append(asyncio.create_task(self._follow(self._source)))
            await self._supervise()
        finally:
            for number in (signal.SIGINT, signal.SIGTERM):
                loop.remove_signal_handler(number)
            for task in tasks:
                task.cancel()
            for died in await asyncio.gather(*tasks, return_exceptions=True):
                if isinstance(died, Exception):  # a cancellation is none
                    words = f"a source of commands ended early: {type(died).__name__}: {died}"
                    self._report.problems.append(words)
            self._conclude()
            self._child.close()
            for observer in attached:
                with suppress(Exception):
                    self._report.problems += observer.detach()
            if self._log is not None:
                self._log.close()
        return self._report

    async def _input_came(self) -> bool:
        """Wait for the input; False when somebody stopped or displaced it before it came.

        Raises:
            ContidError: it is wrong, or there is none; nothing was touched.
        """
        awaited = self._awaited
        if awaited is None:
            return True
        telling = asyncio.get_running_loop().call_later(TELL_S, self._options.say, awaited.words)
        try:
            self._source = await awaited.result()
        except GivenUpError:
            return False
        finally:
            telling.cancel()
        return not awaited.stopped

    async def _follow(self, stream: Stream) -> None:
        preflight = build_preflight(self.loaded, self._options.rate_hz, self._options.unreachable)
        await follow_stream(stream, self._send_input, preflight, self._options.say)
        self._send_input(End())

    async def _supervise(self) -> None:
        """Fetch events until the control process is gone; press on when it does not stop in time."""
        loop = asyncio.get_running_loop()
        while self._child.status is None:
            await asyncio.sleep(POLL_S)
            self._child.flush()
            self._fetch()
            if self._child.reader is not None:
                self._notifier.ticked(self._child.reader.written, loop.time())
            if self._give_up_s is not None and loop.time() > self._give_up_s:
                self._report.problems.append("the orderly stop took too long; relaxed at once")
                self._emergency()
            if self._end_s is not None and loop.time() > self._end_s:
                self._report.problems.append(
                    "the control process did not end and was killed; the devices stop by their own dead-man"
                )
                self._child.kill()
                self._report.exit_code = 3
                break
            self._progress()

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
            for record in reader.ticks():
                self._log.add(record)

    def _hear(self, event: Mapping[str, Any]) -> None:
        self._notice(event)
        for listener in self._listeners:
            listener(event)

    def _notice(self, event: Mapping[str, Any]) -> None:
        """What an event means for the report and for the person at the terminal."""
        report, say = self._report, self._options.say
        if event["event"] in ("stopping", "failed", "report"):
            self._notifier.stopping()
        match event["event"]:
            case "fault":
                say(f"{event['robot']}: {event['words']}")
            case "refused":
                say(f"refused: {event['words']}")
            case "bus":
                say(event["words"])
            case "skipped":
                say(f"{event['ticks']} ticks skipped ({event['total']} in all)")
            case "end":
                self.input_moves = False
            case "stopping" if self._give_up_s is not None:
                self._give_up_s = asyncio.get_running_loop().time() + event["seconds"] + PATIENCE_S
            case "started":
                self._started = True
                report.realtime = event["realtime"]
                if event["words"]:
                    say(event["words"])
            case "failed":
                report.ending, report.exit_code = event["words"], event["exit_code"]
            case "robot":
                report.robots[event["robot"]] = event["told"]
            case "report":
                for name in ("ticks", "late", "skipped", "waited", "lateness"):
                    setattr(report, name, event[name])

    def _conclude(self) -> None:
        """The last events, and what they mean for the exit code."""
        self._fetch()
        reader = self._child.reader
        missed = 0
        if reader is not None:
            missed = reader.missed_ticks if self._log is not None else 0
            reader.rewind()
            complete_from_records(self._report, reader.layout, reader.written, reader.ticks())
        report, status = self._report, self._child.status
        if self._terminal:
            sys.stderr.write("\r\x1b[K")
        if report.faulted():
            report.ending = "a fault stopped a robot" if report.exit_code != 130 else report.ending
            report.exit_code = 3
        elif self._interrupts and not self._started and status == -signal.SIGTERM:
            pass  # ended before it had read what to open
        elif status not in (None, 0) and report.exit_code in (0, 130):
            report.ending, report.exit_code = f"the control process ended with status {status}", 3
        if missed:
            report.problems.append(f"{missed} ticks are missing in the command log")

    def _progress(self) -> None:
        """One line at a terminal."""
        if not self._terminal:
            return
        record = self.newest()
        if record is None or (
            self._last is not None and record.tick - self._last.tick < self._options.rate_hz / 5.0
        ):
            return
        self._last = record
        names = [robot.name for robot in self._child.reader.layout.robots] if self._child.reader else []
        modes = ", ".join(
            f"{name} {Mode(robot.mode).name}" for name, robot in zip(names, record.robots, strict=True)
        )
        end = f"/{self._source.end_s:.1f}" if isinstance(self._source, Trajectory) else ""
        at = "" if record.source_s != record.source_s else f"  t {record.source_s:.1f}{end} s"
        skipped = f"  {record.skipped} skipped" if record.skipped else ""
        sys.stderr.write(f"\r\x1b[K{modes}{at}{skipped}")
        sys.stderr.flush()
