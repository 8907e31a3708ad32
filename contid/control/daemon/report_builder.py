"""Builds the report of a run in real time from its events, and completes it at the end."""

from __future__ import annotations

import signal

from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import (
    BusReported,
    OverloadChanged,
    PaceReported,
    TicksSkipped,
    TicksWaited,
)
from contid.control.engine.events.robots import RobotReported
from contid.control.engine.events.run import RunFailed, RunStarted, StopBegan
from contid.control.engine.report import RunReport, complete_from_records
from contid.control.process.ring_reader import RingReader


class ReportBuilder:
    """The report of a run so far.

    Attributes:
        report: updated by every event.
        started: the buses are open.
    """

    def __init__(self, rate_hz: float) -> None:
        self.report = RunReport(ending="the input ended", rate_hz=rate_hz)
        self.started = False
        self._interrupted = False
        #: The control process has reported how its run ended.
        self._closed = False

    def interrupted(self) -> None:
        """A user or a client ended the run."""
        self._interrupted = True
        if not self.report.exit_code:  # a failure that has ended the run stays its end
            self.report.ending, self.report.exit_code = "interrupted", 130

    def problem(self, message: str) -> None:
        """Add a problem to the report."""
        self.report.problems.append(message)

    def broken(self, message: str) -> None:
        """The run ends because a part of it failed."""
        self.report.ending, self.report.exit_code = message, 3

    def stalled(self, silent_s: float, where: str) -> None:
        """The control process stood still and was killed; ``where`` is "" or " in the model of ..."."""
        message = f"the control process stood still for {silent_s:.1f} s{where} and was killed"
        self.problem(f"{message}; the devices stop by their own watchdogs")
        self.broken(message)

    def killed(self) -> None:
        """The control process was killed."""
        self.problem(
            "the control process did not end and was killed; the devices stop by their own watchdogs"
        )
        self.report.exit_code = 3

    def add(self, event: RunEvent) -> None:
        """Add an event of the ring."""
        report = self.report
        match event:
            case RunStarted():
                self.started = True
                report.realtime = event.realtime
            case RunFailed():
                self._closed = True
                report.ending, report.exit_code = event.message, event.exit_code
            case StopBegan(reason="on_host_loss") if not self._interrupted:
                self.broken("robots stopped: the control process got SIGTERM, or the daemon stood still")
            case RobotReported():
                report.robots[event.robot] = event.report
            case BusReported():
                report.buses[event.bus] = event.counts
            case PaceReported():
                self._closed = True
                report.ticks, report.late, report.skipped = event.ticks, event.late, event.skipped
                report.waited, report.lateness = event.waited, event.lateness
                report.longest_gap_ms = event.longest_gap_ms
            case OverloadChanged() if event.rate_hz < event.full_rate_hz:
                report.slowest_hz = min(report.slowest_hz or event.rate_hz, event.rate_hz)
            # The newest figures, in case the control process ends without a report.
            case TicksSkipped():
                report.skipped, report.longest_gap_ms = event.total, event.longest_gap_ms
            case TicksWaited():
                report.waited, report.longest_gap_ms = event.total, event.longest_gap_ms

    def conclude(self, reader: RingReader, status: int | None) -> None:
        """Complete the report after the last event, and set the exit code.

        Args:
            reader: of the ring, in case the control process ended without a report.
            status: exit status of the control process, None when it still runs.
        """
        report = self.report
        reader.rewind()
        complete_from_records(report, reader.layout, reader.written, reader.ticks())
        if report.faulted():
            report.ending = "a fault stopped a robot" if report.exit_code != 130 else report.ending
            report.exit_code = 3
        elif self._interrupted and not self.started and status in (None, 0, -signal.SIGTERM):
            pass  # ended before it opened the buses
        elif not self._closed and report.exit_code in (0, 130):
            how = "still runs" if status is None else f"ended with status {status}"
            self.broken(f"the control process {how}, without a report of the run")
        elif status not in (None, 0) and report.exit_code in (0, 130):
            report.ending, report.exit_code = f"the control process ended with status {status}", 3
