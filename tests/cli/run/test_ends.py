"""How `contid run` ends early: signals, closed terminals, full disks, killed processes."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from contid.client import Client
from contid.remote.protocol.socket_path import is_listening
from contid.session.read import Session
from contid_sessions.info import summarize
from tests.cli.run.running import enabled, feed, journal
from tests.support.command import program
from tests.support.fingers import circle_csv
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_one_signal_is_an_orderly_stop(
    number: signal.Signals, robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    process = started(str(robot(1, on_interrupt="rest")), "--on-end", "hold")
    feed(process, circle_csv(1, period_s=60.0))
    until(enabled(tmp_path), "armed")
    time.sleep(0.3)
    process.send_signal(number)
    out, _ = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "run: interrupted" in out
    last = journal(tmp_path)[-1]
    assert last["event"] == "close"
    for axis in last["axes"].values():
        assert axis["rest"] == "hold"
        assert axis["goal_rad"] == pytest.approx(60.0 / 37.7 * 2 * 3.141592653589793, abs=1e-3)


def test_the_second_signal_relaxes_at_once(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    process = started(str(robot(1, on_interrupt="rest")))
    feed(process, circle_csv(1, period_s=60.0))
    until(enabled(tmp_path), "armed")
    time.sleep(0.4)
    process.send_signal(signal.SIGINT)
    time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    assert process.returncode == 130
    rests = {axis["rest"] for line in journal(tmp_path)[-1:] for axis in line["axes"].values()}
    assert rests == {"relax"}


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGTSTP], ids=["closed terminal", "Ctrl-Z"])
def test_repeated_signals_of_a_terminal_are_one_orderly_stop(
    number: signal.Signals, robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    process = started(str(robot(1, on_interrupt="rest")), "--on-end", "hold")
    feed(process, circle_csv(1, period_s=60.0))
    until(enabled(tmp_path), "armed")
    time.sleep(0.3)
    for _ in range(2):
        process.send_signal(number)
        time.sleep(0.05)
    process.communicate(timeout=30)
    assert process.returncode == 130
    assert {axis["rest"] for axis in journal(tmp_path)[-1]["axes"].values()} == {"hold"}


def test_an_estop_gets_through_after_the_folder_of_the_socket_was_removed(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any], runtime_folder: Path
) -> None:
    """As systemd removes it at the last logout of its user, while a run in tmux goes on."""
    process = started(str(robot(1)), "--on-end", "hold")
    feed(process, circle_csv(1, period_s=60.0))
    until(enabled(tmp_path), "armed")
    shutil.rmtree(runtime_folder)
    path = runtime_folder / "contid" / "fingers.sock"
    until(lambda: is_listening(path), "it listens again", 10.0)
    with Client(path) as client:
        client.estop()
    assert {axis["rest"] for axis in journal(tmp_path)[-1]["axes"].values()} == {"relax"}
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert "fingers.sock was removed; listening there again" in err


@pytest.mark.parametrize("full", [False, True], ids=["reader gone", "reader that does not read"])
def test_a_full_or_closed_stderr_does_not_delay_the_stop(
    full: bool, robot: Callable[..., Path], tmp_path: Path
) -> None:
    reader, writer = os.pipe()
    if full:
        os.set_blocking(writer, False)
        with suppress(BlockingIOError):
            while True:
                os.write(writer, b"." * 4096)
        os.set_blocking(writer, True)
    command = [sys.executable, "-m", "contid", "run", str(robot(1)), "--socket", str(tmp_path / "s")]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=writer)
    os.close(writer)
    try:
        until(enabled(tmp_path), "armed")
        if not full:
            os.close(reader)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=10)
    finally:
        process.kill()
        process.wait()
        if full:
            os.close(reader)
    assert process.returncode == 130
    assert b"run: interrupted" in out


def test_a_log_that_cannot_be_written_any_more_ends_and_the_run_goes_on(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    log = tmp_path / "log.csv"
    os.mkfifo(log)
    reader = os.open(log, os.O_RDONLY | os.O_NONBLOCK)
    process = started(str(robot(1)), "--log", str(log))
    feed(process, circle_csv(1, period_s=1.0))
    until(enabled(tmp_path), "armed")
    os.close(reader)
    out, _ = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "log.csv: the command log ends here, the run continues: Broken pipe" in out


def test_a_run_whose_socket_died_stops_orderly(robot: Callable[..., Path], tmp_path: Path) -> None:
    script = f"""
import asyncio
from contid.control.engine.tick_layout import ENABLED
from contid.control.daemon.run import RunRequest, run

class Dying:
    async def serve(self, orders):
        while orders.newest() is None or not orders.newest().robots[0].flags & ENABLED:
            await asyncio.sleep(0.01)
        raise OSError("gone")

report = run(RunRequest(robot_file={str(robot(1, on_interrupt="rest"))!r}, commands=[Dying()]))
print(report)
raise SystemExit(report.exit_code)
"""
    done = subprocess.run(
        program(script), stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 3, done.stderr
    assert "run: a source of commands ended early: OSError: gone" in done.stdout
    assert {axis["rest"] for axis in journal(tmp_path)[-1]["axes"].values()} == {"hold"}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_to_every_process_of_a_run_is_one_orderly_stop(
    number: signal.Signals, robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    """As service managers send them; its recorder completes the recording all the same."""
    session = tmp_path / "a.mcap"
    process = started(str(robot(1, on_interrupt="rest")), "--record", str(session))
    feed(process, circle_csv(1, period_s=60.0))
    until(enabled(tmp_path), "armed")
    for each in [*psutil.Process(process.pid).children(), process]:
        each.send_signal(number)
    out, _ = process.communicate(timeout=30)
    assert process.returncode == 130, out
    assert {axis["rest"] for axis in journal(tmp_path)[-1]["axes"].values()} == {"hold"}
    assert summarize(Session(session)).state.startswith("clean")


def test_an_interrupt_while_the_recording_is_compacted_keeps_the_report(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    """The robots have come to rest; the recorder is stopped here, as if it compacted for long."""
    process = started(str(robot(1)), "--record", str(tmp_path / "a.mcap"))
    feed(process, circle_csv(1, period_s=0.5))
    until(enabled(tmp_path), "armed")
    family = psutil.Process(process.pid).children()
    (recorder,) = [each for each in family if "contid.session.mcap_recorder" in each.cmdline()]
    (control,) = [each for each in family if "contid.control.process" in each.cmdline()]
    recorder.suspend()
    try:
        until(lambda: not psutil.pid_exists(control.pid), "the run has ended")
        for _ in range(10):  # ignored until the run waits for nothing but the recorder
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(timeout=1)
                break
    finally:
        recorder.resume()
    out, _ = process.communicate(timeout=30)
    assert "run: the input ended (exit code 0)" in out
    assert "still being compacted" in out
    assert process.returncode == 0


def test_killing_the_daemon_brings_the_robot_to_on_host_loss(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    process = started(str(robot(1)))
    feed(process, circle_csv(1, period_s=60.0))
    until(enabled(tmp_path), "armed")
    time.sleep(0.3)
    family = psutil.Process(process.pid).children()
    (control,) = [each for each in family if "contid.control.process" in each.cmdline()]
    process.kill()
    process.wait()
    control.wait(timeout=10)
    last = journal(tmp_path)[-1]
    assert last["event"] == "close"
    assert {axis["rest"] for axis in last["axes"].values()} == {"relax"}
    assert not any("trip" in line["event"] for line in journal(tmp_path))
    assert not list(Path("/dev/shm").glob(f"contid-{process.pid}-*"))


def test_a_control_process_that_hangs_is_ended_all_the_same(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    """A bus that never comes back holds up the tick for ever; Ctrl-C still ends the run, and it reports."""
    late = "faults: [{at_s: 0.6, kind: late, delay_ms: 600000}]"
    process = started(str(robot(1, options=late)), "--json")
    feed(process, circle_csv(1, period_s=60.0))
    until(lambda: any("late" in line["event"] for line in journal(tmp_path)), "stuck")
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=30)
    report = json.loads(out)
    assert process.returncode == report["exit_code"] == 3
    assert report["ticks"] > 0
    assert report["robots"]["f0"]["mode"] in ("APPROACH", "RUN")
    assert any("watchdog" in problem for problem in report["problems"])
