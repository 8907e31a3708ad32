"""Log records of drivers and daemon reach stderr, `status` and the recording of a real run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from contid.client import Client
from contid.control.engine.events.json_form import to_json
from contid.control.engine.events.run import LogWritten
from contid.control.engine.wiring import wired_buses
from contid.errors import ContidError
from contid.robot_file.load import load_robot_file
from contid.session.read import Session
from contid_drivers.dynamixel import registers as reg
from contid_emulate.dynamixel.bench import Bench

pytestmark = [pytest.mark.process, pytest.mark.realtime]

ROOT = Path(__file__).parents[3]
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "drivers")))}
#: The driver warns of firmware without Fast Sync Read.
OLD_FIRMWARE = 41
WARNING = f"id 1 has {OLD_FIRMWARE}"


@pytest.fixture
def hand(tmp_path: Path, configs: Path) -> Iterator[Path]:
    """The shipped hand on emulated servos, one of them with old firmware."""
    text = (configs / "hand.emulated.yaml").read_text().replace("./hand.tty", str(tmp_path / "hand.tty"))
    path = tmp_path / "hand.yaml"
    text = text.replace("rate_hz: 200\n", "rate_hz: 50\n")
    path.write_text(text.replace("    baud: 1000000\n", "    baud: 1000000\n    usb_latency_ms: 15\n"))
    (bus,) = wired_buses(load_robot_file(path))
    bench = Bench(bus.wiring.name, bus.wiring.options, bus.axes)  # type: ignore[arg-type]
    with bench:
        bench.emulator.servo(1).memory[reg.FIRMWARE.address] = OLD_FIRMWARE
        yield path


@contextmanager
def running(robot_file: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """`contid run` with a socket and a recording beside the robot file."""
    socket, record = robot_file.with_name("s.sock"), robot_file.with_name("run.mcap")
    command = [sys.executable, "-m", "contid", "run", str(robot_file), "--socket", str(socket)]
    process = subprocess.Popen(
        [*command, "--record", str(record), *options],
        env=ENVIRONMENT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        for child in psutil.Process(process.pid).children(recursive=True) if process.poll() is None else ():
            child.kill()
        process.kill()
        process.communicate()


def status_with_warnings(robot_file: Path) -> dict[str, Any]:
    deadline_s = time.monotonic() + 30.0
    while time.monotonic() < deadline_s:
        try:
            with Client(str(robot_file.with_name("s.sock"))) as client:
                if (status := client.status())["warnings"]:
                    return dict(status)
        except ContidError:
            pass
        time.sleep(0.05)
    raise AssertionError("status never had a warning")


def stop(process: subprocess.Popen[str]) -> str:
    process.send_signal(signal.SIGINT)
    return process.communicate(timeout=60)[1]


def logs(robot_file: Path) -> Sequence[dict[str, Any]]:
    events = Session(robot_file.with_name("run.mcap")).events()
    return [to_json(event) for event in events if isinstance(event, LogWritten)]


def test_records_of_a_verbose_run_are_on_stderr_in_status_and_in_the_recording(hand: Path) -> None:
    with running(hand, "--disarmed", "-v") as process:
        warnings = status_with_warnings(hand)["warnings"]
        command = [sys.executable, "-m", "contid", "status", "--socket", str(hand.with_name("s.sock"))]
        shown = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=True).stdout
        stderr = stop(process)
    warning, *_ = [each for each in warnings if WARNING in each["message"]]
    assert (warning["level"], warning["logger"]) == ("warning", "contid_drivers.dynamixel.link")
    assert f"contid: warning: {warning['message']}\n" in stderr
    assert "warning: " in shown
    recorded = [event for event in logs(hand) if WARNING in event["message"]]
    # Once for each time that the bus was opened; on a busy machine it is opened again.
    assert stderr.count(WARNING) == len(recorded) >= 1
    for event in recorded:
        assert event == {
            "event": "log", "process": "control", "level": "warning",
            "logger": warning["logger"], "message": warning["message"],
        }  # fmt: skip
    debug = [event for event in logs(hand) if event["level"] == "debug"]
    assert {event["process"] for event in debug} == {"control", "daemon"}
    assert all(f"contid: debug: {event['message']}\n" in stderr for event in debug)


def test_quiet_hides_information_on_stderr_but_not_in_the_recording(hand: Path) -> None:
    with running(hand, "--disarmed", "-q") as process:
        status_with_warnings(hand)
        stderr = stop(process)
    assert WARNING in stderr
    assert "Stopping" not in stderr
    (recorded,) = [event for event in logs(hand) if event["process"] == "daemon"]
    assert (recorded["level"], recorded["logger"]) == ("info", "contid.control.daemon.daemon")
    assert recorded["message"].startswith("Stopping")


def test_a_wrong_row_is_in_the_recording_of_a_run_in_virtual_time(tmp_path: Path, configs: Path) -> None:
    record = tmp_path / "run.mcap"
    command = [sys.executable, "-m", "contid", "run", str(configs / "finger.yaml"), "--virtual"]
    done = subprocess.run(
        [*command, "--record", str(record)],
        env=ENVIRONMENT,
        input="x_mm,y_mm\n10,70\nten,70\n10,70\n",
        capture_output=True,
        text=True,
        check=False,
    )
    (event,) = logs(tmp_path / "hand.yaml")
    assert event["level"] == "warning"
    assert event["message"].startswith("stdin:3:1: ")
    assert f"contid: warning: {event['message']}\n" in done.stderr
