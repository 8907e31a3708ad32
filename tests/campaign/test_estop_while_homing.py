"""`contid home` on wires, stopped by every means while it searches: torque off, the file as it was, 130."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from contid.control.engine.wiring import wired_buses
from contid.robot_file.load import load_robot_file
from contid_drivers.due.options import DueBusOptions as DueOptions
from contid_drivers.dynamixel.options import DynamixelBusOptions as ServoOptions
from contid_emulate.due import DueEmulator as Board
from contid_emulate.dynamixel.bench import Bench
from tests.support.waiting import until

#: Driven by these hands: whether a search is under way, and whether any output is driven.
Look = Callable[[], bool]
DRIVES = 2
pytestmark = [pytest.mark.campaign, pytest.mark.realtime]


@contextmanager
def servos(folder: Path, configs: Path) -> Iterator[tuple[Path, Look]]:
    text = (configs / "finger.emulated.yaml").read_text()
    search = "{method: hard_stop, direction: -1, current_ma: 120, speed_deg_s: 20, at_mm: 0, timeout_s: 60}"
    text = re.sub(r"port: \S+", f"port: {folder}/servos.tty\n    usb_latency_ms: 40", text)
    text = re.sub(r"(id: \d+, )", rf"\1homing: {search}, ", text)
    path = folder / "homed.yaml"
    path.write_text(text)
    (bus,) = wired_buses(load_robot_file(path))
    assert isinstance(bus.wiring.options, ServoOptions)
    bench = Bench(bus.wiring.name, bus.wiring.options, bus.axes)
    with bench:
        yield path, lambda: any(bench.emulator.servo(s.device).torque for s in bench.emulator.servos)


@contextmanager
def motors(folder: Path, configs: Path) -> Iterator[tuple[Path, Look]]:
    text = (configs / "trirack.emulated.yaml").read_text()
    search = "{direction: -1, at_deg: 199.2, at_mm: 43.5, speed_deg_s: 5}"
    text = re.sub(r"port: \S+", f"port: {folder}/motors.tty\n    latency_ms: 40", text)
    path = folder / "homed.yaml"
    path.write_text(text.replace("channel: m0, ", f"channel: m0, homing: {search}, "))
    (bus,) = wired_buses(load_robot_file(path))
    assert isinstance(bus.wiring.options, DueOptions)
    with Board(bus.wiring.options, bus.axes) as board:
        yield path, lambda: any(float(board.command(f"get {n}").split()[4]) == DRIVES for n in range(3))


def _order(verb: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "contid", verb, "--json"], capture_output=True, text=True, timeout=30
    )
    assert done.returncode == 0, done.stderr


def _twice(process: subprocess.Popen[str]) -> None:
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGINT)
    time.sleep(0.002)
    process.send_signal(signal.SIGINT)


WAYS: dict[str, Callable[[subprocess.Popen[str]], None]] = {
    "Ctrl-C": lambda process: process.send_signal(signal.SIGINT),
    "Ctrl-C again and again": _twice,
    "SIGTERM": lambda process: process.send_signal(signal.SIGTERM),
    "contid estop": lambda process: _order("estop"),
    "contid stop": lambda process: _order("stop"),
}


@pytest.mark.parametrize(
    ("devices", "way"),
    [*((servos, way) for way in WAYS), (motors, "Ctrl-C again and again"), (motors, "contid estop")],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_a_search_that_is_stopped_leaves_nothing_driven(
    devices: Callable[..., Iterator[tuple[Path, Look]]], way: str, tmp_path: Path, configs: Path
) -> None:
    with devices(tmp_path, configs) as (path, driven):  # type: ignore[attr-defined]
        before = path.read_text()
        process = subprocess.Popen(
            [sys.executable, "-m", "contid", "home", str(path)], stderr=subprocess.PIPE, text=True
        )
        try:
            until(lambda: driven() or process.poll() is not None, "it searches")
            assert process.poll() is None, process.communicate()[1]
            WAYS[way](process)
            stderr = process.communicate(timeout=30)[1]
        finally:
            process.kill()
            process.communicate()
        assert not driven()
        assert process.returncode == 130, stderr
        assert "Traceback" not in stderr
        assert path.read_text() == before


def test_a_zero_that_was_found_is_kept_when_a_later_axis_is_interrupted(
    tmp_path: Path, configs: Path
) -> None:
    with servos(tmp_path, configs) as (path, driven):
        path.write_text(path.read_text().replace("speed_deg_s: 20", "speed_deg_s: 360", 1))
        before = path.read_text()
        process = subprocess.Popen(
            [sys.executable, "-m", "contid", "home", str(path)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            until(lambda: path.read_text() != before or process.poll() is not None, "the first zero")
            process.send_signal(signal.SIGINT)
            _, stderr = process.communicate(timeout=30)
        finally:
            process.kill()
            process.communicate()
        assert process.returncode == 130, stderr
        assert not driven()
        changed = [line for line in path.read_text().splitlines() if line not in before.splitlines()]
        assert len(changed) == 1
        assert "homed 20" in changed[0]
        assert load_robot_file(path).file.robots
