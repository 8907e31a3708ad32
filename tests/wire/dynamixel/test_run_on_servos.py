"""`contid run` with the shipped hand on emulated servos: what the supervisor makes of faults, and kill -9."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import psutil
import pytest

from contid.control.engine.wiring import wired_buses
from contid.robot_file.load import load_robot_file
from contid_emulate.dynamixel import DynamixelEmulator
from contid_emulate.dynamixel.bench import Bench
from tests.support.command import environment

pytestmark = [pytest.mark.process, pytest.mark.realtime]

ROOT = Path(__file__).parents[3]
IDS = (1, 2, 3, 4)
WATCHDOG_S = 0.4


def contid(*message: str) -> Sequence[str]:
    return [sys.executable, "-m", "contid", *message]


@pytest.fixture
def hand(tmp_path: Path, configs: Path) -> Path:
    """The shipped file; only time-outs are longer, because tests share the machine."""
    text = (configs / "hand.emulated.yaml").read_text()
    text = text.replace("./hand.tty", str(tmp_path / "hand.tty"))
    text = text.replace(
        "    baud: 1000000\n",
        "    baud: 1000000\n    usb_latency_ms: 15\n    watchdog_ms: 400\n",
    ).replace("tolerance_ticks: 10\n", "tolerance_ticks: 20\n")
    (tmp_path / "hand.yaml").write_text(text)
    return tmp_path / "hand.yaml"


@pytest.fixture
def emulator(hand: Path) -> Iterator[DynamixelEmulator]:
    (bus,) = wired_buses(load_robot_file(hand))
    bench = Bench(bus.wiring.name, bus.wiring.options, bus.axes)  # type: ignore[arg-type]
    with bench:
        yield bench.emulator


@pytest.fixture
def running(hand: Path, emulator: DynamixelEmulator) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start following the circle; returns once all four servos move."""
    started: list[subprocess.Popen[str]] = []

    def start(laps: int) -> subprocess.Popen[str]:
        circle = hand.with_name("circle.csv")
        shape = (
            "path",
            "circle",
            "--center",
            "50,70",
            "--size",
            "20",
            "--period",
            "1.5",
            "--laps",
            str(laps),
        )
        circle.write_text(
            subprocess.run(
                contid(*shape, "--for", str(hand)),
                env=environment(),
                check=True,
                capture_output=True,
                text=True,
            ).stdout
        )
        process = subprocess.Popen(
            contid("run", str(hand), "--trajectory", str(circle), "--json"),
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        began = [emulator.servo(i).position_ticks for i in IDS]
        until(
            lambda: all(
                abs(emulator.servo(i).position_ticks - p) > 200 for i, p in zip(IDS, began, strict=True)
            ),
            process,
        )
        return process

    yield start
    for process in started:
        for child in psutil.Process(process.pid).children(recursive=True) if process.poll() is None else ():
            child.kill()
        process.kill()
        process.communicate()


def until(condition: Callable[[], bool], process: subprocess.Popen[str] | None = None) -> None:
    deadline = time.monotonic() + 30
    while not condition():
        if process is not None and process.poll() is not None:
            raise AssertionError(f"contid ended: {process.stderr.read() if process.stderr else ''}")
        assert time.monotonic() < deadline, "it never became true"
        time.sleep(0.005)


def report_of(process: subprocess.Popen[str]) -> dict[str, Any]:
    out, err = process.communicate(timeout=60)
    assert out, err
    report: dict[str, Any] = json.loads(out.splitlines()[-1])
    return report


def test_kill_9_of_daemon_and_control_process_stops_every_servo(
    running: Callable[..., subprocess.Popen[str]], emulator: DynamixelEmulator
) -> None:
    process = running(40)
    family = [*psutil.Process(process.pid).children(recursive=True), psutil.Process(process.pid)]
    assert all(emulator.servo(i).torque and not emulator.servo(i).tripped for i in IDS)
    # Both at once: stopped first, so that neither notices the death of the other.
    for member in family:
        member.send_signal(signal.SIGSTOP)
    for member in family:
        member.send_signal(signal.SIGKILL)
    until(lambda: all(emulator.servo(i).tripped for i in IDS))
    for i in IDS:
        servo = emulator.servo(i)
        # By the servo's own clock, from the last instruction it received.
        assert servo.stopped_at - servo.fed_at == pytest.approx(WATCHDOG_S, abs=0.003)
    stopped = [emulator.servo(i).position_ticks for i in IDS]
    time.sleep(0.2)
    assert [emulator.servo(i).position_ticks for i in IDS] == stopped


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("overload", "overload"),
        ("silent", ""),
        # Their messages by the driver alone: test_faults, test_return_with_torque.
        pytest.param("trip", "Bus Watchdog tripped", marks=pytest.mark.campaign),
        pytest.param("brownout", "reset itself", marks=pytest.mark.campaign),
    ],
)
def test_a_servo_in_trouble_faults_its_whole_robot_and_the_other_one_finishes(
    running: Callable[..., subprocess.Popen[str]], emulator: DynamixelEmulator, kind: str, message: str
) -> None:
    process = running(2)
    emulator.set(kind, 3)
    report = report_of(process)
    assert report["exit_code"] == process.returncode == 3
    right, left = report["robots"]["right"], report["robots"]["left"]
    assert right["message"]
    assert message in right["message"]
    assert left["message"] == ""
    assert left["ticks_followed"] > right["ticks_followed"]
    (counts,) = report["buses"].values()
    assert counts["exchanges"] >= left["ticks_followed"]
    assert counts["silent"] >= (20 if kind == "silent" else 0)


def test_unplugging_faults_every_robot_of_the_bus_and_the_servos_stop_themselves(
    running: Callable[..., subprocess.Popen[str]], emulator: DynamixelEmulator
) -> None:
    process = running(40)
    emulator.set("unplug")
    report = report_of(process)
    assert process.returncode == 3
    assert all("is gone" in robot["message"] for robot in report["robots"].values())
    until(lambda: all(emulator.servo(i).tripped for i in IDS))
    stopped = [emulator.servo(i).position_ticks for i in IDS]
    emulator.set("replug")
    time.sleep(0.1)
    assert [emulator.servo(i).position_ticks for i in IDS] == stopped
