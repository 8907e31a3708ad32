"""One run from its request to its report: the order in which things are read, checked, started and ended.

The control process is started first and imports while the robot file and the trajectory are read; nothing is
handed to it, and nothing moves, before both were found good. Clients are served while the trajectory is
waited for.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from contid.control.awaited import Awaited
from contid.control.child import ControlChild
from contid.control.command_log import CommandLog
from contid.control.cycle import OnEnd, Sink
from contid.control.daemon import Daemon, RunOptions
from contid.control.inputs import Stream, given, read_file, read_stdin
from contid.control.messages import Message, Rows
from contid.control.patience import Patience
from contid.control.preflight import Preflight, Unreachable
from contid.control.report import Report
from contid.control.roles import Commands, Observer
from contid.control.setup import Setup
from contid.control.spawn import Spawned
from contid.control.streaming import CUT, may_be_cut, take_row
from contid.control.terminal import checking, say, words_of
from contid.control.virtual import run_virtual
from contid.control.wiring import build_preflight, driven_robots, record_layout
from contid.description.dead_man import starved
from contid.description.load import LoadedFile, load_robot_file, with_mock
from contid.description.robot_file import MAX_RATE_HZ
from contid.description.shipped import find_robot_file
from contid.errors import ContidError
from contid.targets import Target
from contid.trajectory.timed import Trajectory


@dataclass(frozen=True, slots=True)
class RunRequest:
    """What the command line asked for, as it said it.

    Attributes:
        robot_file: path or name of a shipped one.
        mock: simulated devices.
        trajectory: file of timed rows; None for stdin.
        rate_hz: instead of the file's.
        on_end: `contid.control.cycle.OnEnd`.
        unreachable: `contid.control.preflight.Unreachable`.
        virtual: in virtual time.
        log: where to write every command.
        disarmed: connect only; arm on `resume`.
        commands: further sources of orders.
        observers: readers of the ring.
    """

    robot_file: str
    mock: bool = False
    trajectory: str | None = None
    rate_hz: float | None = None
    on_end: str = "stop"
    unreachable: str = "refuse"
    virtual: bool = False
    log: Path | None = None
    disarmed: bool = False
    commands: Sequence[Commands] = ()
    observers: Sequence[Observer] = ()


def run(request: RunRequest, spawned: Spawned | None = None) -> Report:
    """Run to the end, with a control process that was started already, or a new one.

    Raises:
        ContidError: nothing was started: a wrong file, an unreachable row.
    """
    if request.virtual and request.disarmed:
        raise ContidError("--disarmed waits for orders, and --virtual has nobody to give them: leave one out")
    if request.virtual:
        loaded = load(request)
        with closing(Patience()) as patience:
            source = read(request, loaded, patience)
        return _virtual(request, loaded, source)
    with ExitStack() as stack:
        child = ControlChild(spawned)
        stack.callback(child.close)
        loaded = load(request)
        options = RunOptions(
            rate_hz=request.rate_hz or loaded.file.rate_hz,
            on_end=OnEnd(request.on_end),
            unreachable=Unreachable(request.unreachable),
            log=request.log,
            armed=not request.disarmed,
            commands=request.commands,
            observers=request.observers,
        )
        return asyncio.run(Daemon(loaded, awaited(request, loaded), options, child).run())


def load(request: RunRequest) -> LoadedFile:
    """The robot file, checked."""
    loaded = load_robot_file(find_robot_file(request.robot_file))
    if request.rate_hz is not None:
        if not 0.0 < request.rate_hz <= MAX_RATE_HZ:
            words = f"above 0, at most {MAX_RATE_HZ:g}, as rate_hz in a robot file"
            raise ContidError(f"--rate: {request.rate_hz:g}; allowed: {words}")
        for message in starved(loaded.buses.values(), request.rate_hz):
            raise ContidError(f"--rate: {message}")
    return with_mock(loaded) if request.mock else loaded


def read(request: RunRequest, loaded: LoadedFile, patience: Patience) -> Trajectory | Stream | None:
    """What to follow, checked; waits for it.

    Raises:
        ContidError: it is wrong, or there is none where one was expected.
        GivenUpError: nobody waits any more.
    """
    robots = driven_robots(loaded)
    source: Trajectory | Stream
    if request.trajectory is not None:
        source = read_file(request.trajectory, robots)
    elif given(sys.stdin):
        source = read_stdin(sys.stdin, robots, patience)
    else:
        return None
    if isinstance(source, Trajectory):
        rate_hz = request.rate_hz or loaded.file.rate_hz
        preflight = build_preflight(loaded, rate_hz, Unreachable(request.unreachable))
        if preflight is not None:
            show = checking(len(source))

            def progress(done: int, total: int) -> None:
                patience.check()
                show(done, total)

            preflight.trajectory(source, request.trajectory or "stdin", progress)
    return source


def awaited(request: RunRequest, loaded: LoadedFile) -> Awaited | None:
    """The input of a run in real time, still to be read; None when there is none to wait for."""
    if request.trajectory is None and not given(sys.stdin):
        return None
    words = "waiting for a trajectory on stdin" if request.trajectory is None else "checking the trajectory"
    return Awaited(words, lambda patience: read(request, loaded, patience))


def _virtual(request: RunRequest, loaded: LoadedFile, source: Trajectory | Stream | None) -> Report:
    """In virtual time; a stream gives one row per tick."""
    rate_hz = request.rate_hz or loaded.file.rate_hz
    with ExitStack() as stack:
        sinks: list[Sink] = [Messages()]
        if request.log is not None:
            log = CommandLog(request.log, record_layout(loaded, rate_hz))
            stack.callback(log.close)
            sinks.append(log)
        on_end = OnEnd(request.on_end)
        if source is None:
            raise ContidError("--virtual has nothing to follow: give --trajectory, or a trajectory on stdin")
        timed = source if isinstance(source, Trajectory) else None
        setup = Setup(loaded, rate_hz, Path(), timed, on_end, attended=False)
        for observer in request.observers:
            sinks.append(observer.follow(setup))
            stack.callback(observer.detach)
        if isinstance(source, Stream):
            rows = _rows(source, build_preflight(loaded, rate_hz, Unreachable(request.unreachable)))
            return run_virtual(loaded, rate_hz, None, sinks=sinks, on_end=on_end, rows=rows)
        return run_virtual(loaded, rate_hz, source, sinks=sinks, on_end=on_end)


class Messages:
    """A sink that tells a person about faults and refusals."""

    def write(self, values: list[float]) -> None:
        """Records are for others."""

    def event(self, kind: str, **fields: Any) -> None:
        """See `contid.control.cycle.Sink`."""
        if words := words_of({"event": kind, **fields}):
            say(words)


def _rows(stream: Stream, preflight: Preflight | None) -> Iterator[Mapping[str, Target | None]]:
    """Rows of a stream as they are read, waiting for each."""
    taken: list[Message] = []
    lines = [*stream.pending]
    with open(stream.descriptor, encoding="utf-8", errors="replace", closefd=False) as file:
        for number, line in [*lines, *enumerate(file, stream.number + 1)]:
            if may_be_cut(stream, line):
                say(f"{stream.name}:{number}:1: {CUT}")
                return
            take_row(stream, line, number, taken.append, preflight, say, stream.parser.robots)
            for message in taken:
                if isinstance(message, Rows):
                    yield message.targets
            taken.clear()
