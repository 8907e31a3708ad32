"""A control process that ends without its closing report, or because of a stranger, is no success."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import psutil
import pytest

from contid.control.daemon.report_builder import ReportBuilder
from contid.control.engine.events.run import RunFailed, StopBegan
from tests.support.daemons import Running, armed, daemon
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: Runs in the control process only, before anything else; its simulated bus is then that of a bad library.
LIBRARY = """\
import sys
if "contid.control.process" in sys.orig_argv:
    import os
    from contid_drivers.sim.bus import SimBus
    exchange, calls = SimBus.exchange, 0
    def bad(self, commands):
        global calls
        calls += 1
        if calls == 100:
            {does}
        return exchange(self, commands)
    SimBus.exchange = bad
"""


def control_of(running: Running) -> int:
    """The process id of the control process."""
    (control,) = [
        child.pid
        for child in psutil.Process(running.process.pid).children()
        if "contid.control.process" in child.cmdline()
    ]
    return control


def ended(running: Running) -> tuple[int, str, str]:
    """Exit code of the daemon, the ending in its report, and its messages."""
    out, messages = running.process.communicate(timeout=30)
    return running.process.returncode, json.loads(out)["ending"], messages


def test_a_signal_to_the_control_process_is_no_end_of_the_input() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        os.kill(control_of(running), signal.SIGTERM)
        code, ending, _ = ended(running)
        assert code == 3
        assert "the control process was told to end (SIGTERM), but not by this daemon" in ending


@pytest.mark.parametrize("status", [0, 7])
def test_an_exit_inside_a_driver_is_no_success(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, status: int
) -> None:
    (tmp_path / "sitecustomize.py").write_text(LIBRARY.format(does=f"os._exit({status})"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
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
