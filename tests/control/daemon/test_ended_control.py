"""A control process that ends without its closing report, or because of a stranger, is no success."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from contid.control.daemon.report_builder import ReportBuilder
from contid.control.engine.events.run import RunFailed, StopBegan
from contid.control.engine.report import LAST_TICK
from contid.control.process.control_process import STANDS_S, ParentWatch
from contid.control.process.pipe import Inbox
from tests.control.daemon.ended_control import LIBRARY, at_start, control_of, ended
from tests.support.daemons import HERE, armed, states
from tests.support.daemons import fast_daemon as daemon
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


def test_a_signal_to_the_control_process_is_no_end_of_the_input() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        os.kill(control_of(running), signal.SIGTERM)
        code, ending, _ = ended(running)
        assert code == 3
        assert ending == "robots stopped: the control process got SIGTERM, or the daemon stood still"


def test_robots_of_a_daemon_that_stands_still_stop_and_a_short_pause_is_none() -> None:
    """A stop by a client or Ctrl-C would not get through."""

    def is_dead(process: int) -> bool:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"

    with daemon() as running, running.client() as client:
        armed(client)
        control = control_of(running)
        running.process.send_signal(signal.SIGSTOP)
        time.sleep(0.5 * STANDS_S)
        running.process.send_signal(signal.SIGCONT)
        until(lambda: states(client) == {"HOLD"}, "it goes on")
        client.move(HERE, wait=False)
        began_s = time.monotonic()
        running.process.send_signal(signal.SIGSTOP)
        until(lambda: is_dead(control), "the robots are at rest, and the control process has ended")
        took_s = time.monotonic() - began_s
        running.process.send_signal(signal.SIGCONT)
        code, ending, messages = ended(running)
    assert took_s > STANDS_S
    assert (code, ending.partition(":")[0]) == (3, "robots stopped")
    assert "the daemon stood still for 3 s: no stop would get through, robots stop" in messages


def test_only_ticks_in_which_the_daemon_does_not_look_count() -> None:
    reading, writing = os.pipe()
    watch = ParentWatch(Inbox(reading))
    for tick in range(2000):
        watch.count(tick // 500, 200.0)
    assert not watch.parent_gone
    for _ in range(101):
        watch.count(3, 200.0)
    assert not watch.parent_gone, "600 ticks after the one with the last look are 3 s"
    watch.count(3, 200.0)
    assert watch.parent_gone
    os.close(reading)
    os.close(writing)


def test_states_after_a_kill_are_those_of_the_last_tick() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        os.kill(control_of(running), signal.SIGKILL)
        out, _ = running.process.communicate(timeout=30)
    report = json.loads(out)
    assert running.process.returncode == 3
    assert report["robots"]["f0"]["mode"] == "HOLD"
    assert report["problems"] == [LAST_TICK]


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


#: The simulated bus of the control process opens for ever.
OPENING = """\
import sys
if "contid.control.process" in sys.orig_argv:
    import pathlib, time
    from contid_drivers.sim.bus import SimBus
    def open(self):
        pathlib.Path("opening").touch()
        time.sleep(1000.0)
    SimBus.open = open
"""


def test_ctrl_c_while_a_bus_opens_is_no_defect_of_its_driver(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The signal comes inside the driver, whose own `SystemExit` would be a defect."""
    at_start(monkeypatch, tmp_path, OPENING)
    command = [sys.executable, "-m", "contid", "run", "finger", "--mock", "--json"]
    with subprocess.Popen(
        command, cwd=tmp_path, text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as running:  # fmt: skip
        until((tmp_path / "opening").exists, "the bus opens")
        running.send_signal(signal.SIGINT)
        out, messages = running.communicate(timeout=60)
    assert (running.returncode, json.loads(out)["ending"]) == (130, "interrupted"), messages


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
