"""The report of a run in real time: gathered from its events while it runs, completed when it has ended."""

from __future__ import annotations

import signal
from collections.abc import Mapping
from typing import Any

from contid.control.engine.report import RunReport, complete_from_records
from contid.control.process.ring import RingReader


class ReportBuilder:
    """What is known of a run so far.

    Attributes:
        report: filled as events come in.
        started: the buses are open.
    """

    def __init__(self, rate_hz: float) -> None:
        self.report = RunReport(ending="the input ended", rate_hz=rate_hz)
        self.started = False
        self._interrupted = False

    def interrupted(self) -> None:
        """Somebody asked the run to end."""
        self._interrupted = True
        self.report.ending, self.report.exit_code = "interrupted", 130

    def problem(self, message: str) -> None:
        """Something could not be done."""
        self.report.problems.append(message)

    def broken(self, message: str) -> None:
        """It ends because a part of it did."""
        self.report.ending, self.report.exit_code = message, 3

    def killed(self) -> None:
        """The control process had to be ended by force."""
        self.problem("the control process did not end and was killed; the devices stop by their own dead-man")
        self.report.exit_code = 3

    def hear(self, event: Mapping[str, Any]) -> None:
        """An event of the ring."""
        report = self.report
        match event["event"]:
            case "started":
                self.started = True
                report.realtime = event["realtime"]
            case "failed":
                report.ending, report.exit_code = event["message"], event["exit_code"]
            case "robot":
                report.robots[event["robot"]] = event["told"]
            case "report":
                for name in ("ticks", "late", "skipped", "waited", "lateness"):
                    setattr(report, name, event[name])

    def conclude(self, reader: RingReader, status: int | None) -> None:
        """Every event was heard: complete the report, and find what the end means for the exit code.

        Args:
            reader: of the ring, for what the control process did not live to report.
            status: exit status of the control process, None when it had to be left behind.
        """
        report = self.report
        reader.rewind()
        complete_from_records(report, reader.layout, reader.written, reader.ticks())
        if report.faulted():
            report.ending = "a fault stopped a robot" if report.exit_code != 130 else report.ending
            report.exit_code = 3
        elif self._interrupted and not self.started and status == -signal.SIGTERM:
            pass  # ended before it had read what to open
        elif status not in (None, 0) and report.exit_code in (0, 130):
            report.ending, report.exit_code = f"the control process ended with status {status}", 3
