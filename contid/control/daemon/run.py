"""One run from its request to its report.

In real time the control process starts first and imports while the robot file and the trajectory are read.
It gets its setup only after both were checked; clients are served while the trajectory is pending. A run in
virtual time takes place in this process.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing
from itertools import chain
from pathlib import Path

from contid.control.daemon.control_child import ControlChild
from contid.control.daemon.daemon import Daemon
from contid.control.daemon.inputs import CancellableReader, Stream
from contid.control.daemon.row_stream import LiveRowReader, ends
from contid.control.daemon.run_request import RunRequest, load, open_input, preflight_of, rate_of, read_input
from contid.control.daemon.spawn import Spawned
from contid.control.daemon.terminal import event_text, print_message
from contid.control.daemon.tick_times import check_budget
from contid.control.engine.command_log import CommandLog
from contid.control.engine.cycle import Sink
from contid.control.engine.events import RunEvent
from contid.control.engine.measured_tip import MeasuredTips
from contid.control.engine.report import RunReport, outrun
from contid.control.engine.virtual import Tee, run_virtual
from contid.control.engine.wiring import build_robot_configs, record_layout
from contid.control.process.isolation.model_ports import models_beside
from contid.control.process.log_queue import LogQueue, handle_logs
from contid.control.process.pipe import RunSetup
from contid.control.process.tick_alarm import LONGEST_S
from contid.errors import ContidError
from contid.targets import Target
from contid.trajectory.timed import Trajectory


def run(request: RunRequest, spawned: Spawned | None = None) -> RunReport:
    """Run to the end, with an already started control process or a new one.

    Raises:
        ContidError: wrong file, unreachable row, or a tick that does not fit; nothing was started.
    """
    if request.virtual:
        return _virtual(request)
    with ExitStack() as stack:
        child = ControlChild(spawned)
        stack.callback(child.close)
        loaded = load(request)
        check_budget(loaded, rate_of(request, loaded), "stream" if request.trajectory is None else "path")
        # What is checked before the run is asked here: many rows, and nothing moves yet.
        source = open_input(request, loaded)
        loaded = stack.enter_context(models_beside(loaded, LONGEST_S))
        return asyncio.run(Daemon(loaded, source, request, child).run())


def _virtual(request: RunRequest) -> RunReport:
    """Run in virtual time; a stream gives one row per tick."""
    if not request.armed:
        raise ContidError("--disarmed waits for orders, which --virtual cannot take: leave one out")
    loaded = load(request)
    rate_hz = rate_of(request, loaded)
    with closing(CancellableReader()) as reader:
        source = read_input(request, loaded, reader)
    if source is None:
        raise ContidError("--virtual has nothing to follow: give --trajectory, or a trajectory on stdin")
    with ExitStack() as stack:
        sinks: list[Sink] = [TerminalSink(request.log_level)]
        if request.log is not None:
            log = CommandLog(request.log, record_layout(loaded, rate_hz))
            stack.callback(log.close)
            sinks.append(log)
        timed = source if isinstance(source, Trajectory) else None
        setup = RunSetup(loaded, rate_hz, Path(), timed, request.on_end, attended=False)
        for observer in request.observers:
            sinks.append(observer.follow(setup))
            stack.callback(observer.detach)
        stack.enter_context(handle_logs(min(request.log_level, logging.INFO), SinkHandler(Tee(sinks))))
        live = LiveRowReader(source, preflight_of(request, loaded)) if isinstance(source, Stream) else None
        rows = None if live is None else _rows(live)
        tips = MeasuredTips(build_robot_configs(loaded, rate_hz), record_layout(loaded, rate_hz))
        sinks.append(tips)
        report = run_virtual(loaded, rate_hz, timed, sinks=sinks, on_end=request.on_end, rows=rows)
    tips.complete(report.robots)
    if live is not None:
        report.problems += outrun(report.robots)
        live.complete(report)
    return report


def _rows(reader: LiveRowReader) -> Iterator[Mapping[str, Target | None]]:
    """Rows of a stream, blocking for each."""
    stream = reader.stream
    with open(stream.descriptor, encoding="utf-8", errors="replace", closefd=False) as file:
        for number, line in chain(stream.pending, enumerate(file, stream.number + 1)):
            if ends(stream, line, number):
                return
            row = reader.row(line, number)
            if row is not None:
                yield row.targets


class SinkHandler(LogQueue):
    """Writes log records to a sink of a run in virtual time."""

    def __init__(self, sink: Sink) -> None:
        super().__init__("control")
        self._sink = sink

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler.emit`."""
        super().emit(record)
        self.write(self._sink)


class TerminalSink:
    """A sink that prints faults, refusals and log records."""

    def __init__(self, log_level: int) -> None:
        self._log_level = log_level

    def write(self, values: list[float]) -> None:
        """Records are not printed."""

    def event(self, event: RunEvent) -> None:
        """See `contid.control.engine.cycle.Sink`."""
        if message := event_text(event, self._log_level):
            print_message(message)
