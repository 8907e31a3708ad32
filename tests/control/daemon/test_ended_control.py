"""A control process that ends without its closing report, or because of a stranger, is no success."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from contid.control.daemon.report_builder import ReportBuilder
from contid.control.engine.events.run import RunFailed, StopBegan
from tests.control.daemon.ended_control import LIBRARY, at_start, control_of, ended
from tests.support.daemons import armed
from tests.support.daemons import fast_daemon as daemon
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


def test_a_signal_to_the_control_process_is_no_end_of_the_input() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        os.kill(control_of(running), signal.SIGTERM)
        code, ending, _ = ended(running)
        assert code == 3
        assert "the control process was ended by SIGTERM, but not by this daemon" in ending


@pytest.mark.parametrize("status", [0, 7])
def test_an_exit_inside_a_driver_is_no_success(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, status: int
) -> None:
    at_start(monkeypatch, tmp_path, LIBRARY.format(does=f"os._exit({status})"))
    with daemon() as running:
        until(lambda: running.process.poll() is not None, "the daemon has ended")
        code, ending, _ = ended(running)
        assert code == 3
        assert ending == f"the control process ended with status {status}, without a report of the run"


def test_what_a_person_ended_keeps_its_exit_code() -> None:
    """Ctrl-C while the buses open ends the control process by SIGTERM."""
    report = ReportBuilder(200.0)
    report.interrupted()
    report.add(StopBegan(reason="on_host_loss", seconds=0.0))
    assert report.report.exit_code == 130
    report.add(RunFailed(message="the port is locked", exit_code=4))
    assert report.report.exit_code == 4


def test_ctrl_c_after_a_failure_hides_nothing() -> None:
    """A run that has failed takes a while to end; a person who presses Ctrl-C meanwhile has not ended it."""
    report = ReportBuilder(200.0)
    report.add(RunFailed(message="the port is gone", exit_code=4))
    report.interrupted()
    assert (report.report.ending, report.report.exit_code) == ("the port is gone", 4)
