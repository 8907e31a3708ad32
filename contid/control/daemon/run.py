"""One run from its request to its report: the order in which things are read, checked, started and ended.

In real time the control process is started first and imports while the robot file and the trajectory are
read; nothing is handed to it, and nothing moves, before both were found good. Clients are served while the
trajectory is waited for. In virtual time everything happens here, one after the other.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing
from itertools import chain
from pathlib import Path
from typing import Any

from contid.control.daemon.cancellable_reader import CancellableReader
from contid.control.daemon.control_child import ControlChild
from contid.control.daemon.daemon import Daemon, RunOptions
from contid.control.daemon.inputs import Stream
from contid.control.daemon.row_stream import LiveRowReader
from contid.control.daemon.run_request import RunRequest, awaited, load, preflight_of, rate_of, read
from contid.control.daemon.spawn import Spawned
from contid.control.daemon.terminal import say, words_of
from contid.control.engine.command_log import CommandLog
from contid.control.engine.cycle import OnEnd, Sink
from contid.control.engine.report import RunReport
from contid.control.engine.virtual import run_virtual
from contid.control.engine.wiring import record_layout
from contid.control.process.setup import RunSetup
from contid.control.tick.preflight import Preflight, Unreachable
from contid.errors import ContidError
from contid.targets import Target
from contid.trajectory.timed import Trajectory


def run(request: RunRequest, spawned: Spawned | None = None) -> RunReport:
    """Run to the end, with a control process that was started already, or a new one.

    Raises:
        ContidError: nothing was started: a wrong file, an unreachable row.
    """
    if request.virtual:
        return _virtual(request)
    with ExitStack() as stack:
        child = ControlChild(spawned)
        stack.callback(child.close)
        loaded = load(request)
        options = RunOptions(
            rate_hz=rate_of(request, loaded),
            on_end=OnEnd(request.on_end),
            unreachable=Unreachable(request.unreachable),
            log=request.log,
            armed=not request.disarmed,
            commands=request.commands,
            observers=request.observers,
        )
        return asyncio.run(Daemon(loaded, awaited(request, loaded), options, child).run())


def _virtual(request: RunRequest) -> RunReport:
    """In virtual time; a stream gives one row per tick."""
    if request.disarmed:
        raise ContidError("--disarmed waits for orders, and --virtual has nobody to give them: leave one out")
    loaded = load(request)
    rate_hz, on_end = rate_of(request, loaded), OnEnd(request.on_end)
    with closing(CancellableReader()) as patience:
        source = read(request, loaded, patience)
    with ExitStack() as stack:
        sinks: list[Sink] = [Messages()]
        if request.log is not None:
            log = CommandLog(request.log, record_layout(loaded, rate_hz))
            stack.callback(log.close)
            sinks.append(log)
        if source is None:
            raise ContidError("--virtual has nothing to follow: give --trajectory, or a trajectory on stdin")
        timed = source if isinstance(source, Trajectory) else None
        setup = RunSetup(loaded, rate_hz, Path(), timed, on_end, attended=False)
        for observer in request.observers:
            sinks.append(observer.follow(setup))
            stack.callback(observer.detach)
        rows = _rows(source, preflight_of(request, loaded)) if isinstance(source, Stream) else None
        return run_virtual(loaded, rate_hz, timed, sinks=sinks, on_end=on_end, rows=rows)


def _rows(stream: Stream, preflight: Preflight | None) -> Iterator[Mapping[str, Target | None]]:
    """Rows of a stream as they are read, waiting for each."""
    reader = LiveRowReader(stream, preflight, say)
    with open(stream.descriptor, encoding="utf-8", errors="replace", closefd=False) as file:
        for number, line in chain(stream.pending, enumerate(file, stream.number + 1)):
            if reader.ends(line, number):
                return
            row = reader.row(line, number)
            if row is not None:
                yield row.targets


class Messages:
    """A sink that tells a person about faults and refusals."""

    def write(self, values: list[float]) -> None:
        """Records are for others."""

    def event(self, kind: str, **fields: Any) -> None:
        """See `contid.control.engine.cycle.Sink`."""
        if message := words_of({"event": kind, **fields}):
            say(message)
