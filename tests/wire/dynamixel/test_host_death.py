"""kill -9 of the process that drives the bus: every servo stops by its Bus Watchdog."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from contid_emulate.dynamixel import DynamixelEmulator, Servo
from tests.support.command import program

pytestmark = [pytest.mark.process, pytest.mark.realtime]

ROOT = Path(__file__).parents[3]
WATCHDOG_MS = 100

# Follows a circle with four servos, the way the control process does: one exchange per tick.
CIRCLE = """
import math, sys, time
from contid.hal import AxisOnBus
from contid_drivers.dynamixel import DRIVER
class Clock:
    def now(self): return time.monotonic()
options = DRIVER.bus_options(port=sys.argv[1], watchdog_ms=int(sys.argv[2]), usb_latency_ms=40)
axes = [AxisOnBus(f"r.a{i}", DRIVER.axis_options(id=i)) for i in (1, 2, 3, 4)]
bus = DRIVER.open_bus("servos", options, axes, Clock())
bus.open()
bus.enable(bus.axes)
start = time.monotonic()
print("running", flush=True)
while True:
    t = time.monotonic() - start
    bus.exchange({name: 40 * math.sin(3 * t + i) - 40 * math.sin(i) + 3.1 for i, name in enumerate(bus.axes)})
    time.sleep(0.005)
"""


@contextmanager
def driving(port: str) -> Iterator[subprocess.Popen[str]]:
    paths = {"PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "drivers")))}
    process = subprocess.Popen(
        program(CIRCLE, port, str(WATCHDOG_MS)),
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, **paths},
    )
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "running\n"
        yield process
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_killing_the_driving_process_stops_every_servo(tmp_path: Path) -> None:
    servos = [Servo(i, position_ticks=2048.0) for i in (1, 2, 3, 4)]
    for servo in servos:
        servo.memory[9] = 0
    with DynamixelEmulator(servos, tmp_path / "servos.pty") as emulator, driving(emulator.port) as process:
        time.sleep(0.3)
        assert all(emulator.servo(i).torque for i in (1, 2, 3, 4))
        assert any(emulator.servo(i).motion.velocity for i in (1, 2, 3, 4))
        process.send_signal(signal.SIGKILL)
        process.wait()
        killed = time.monotonic()
        while not all(emulator.servo(i).tripped for i in (1, 2, 3, 4)):
            assert time.monotonic() - killed < 5
            time.sleep(0.005)
        for servo in servos:
            # By the servo's own clock: from the last instruction it received until it stopped.
            assert servo.stopped_at - servo.fed_at == pytest.approx(WATCHDOG_MS / 1e3, abs=0.003)
        stopped = [emulator.servo(i).position_ticks for i in (1, 2, 3, 4)]
        time.sleep(0.1)
        assert [emulator.servo(i).position_ticks for i in (1, 2, 3, 4)] == stopped
        assert not any(servo.motion.velocity for servo in servos)


def test_the_next_process_takes_over_without_a_jump(tmp_path: Path, rig: Callable[..., Any]) -> None:
    r = rig(4)
    with driving(r.emulator.port) as process:
        time.sleep(0.2)
        process.kill()
        process.wait()
    while not all(r.emulator.servo(i).tripped for i in (1, 2, 3, 4)):
        time.sleep(0.01)
    stopped = [r.emulator.servo(i).position_ticks for i in (1, 2, 3, 4)]
    r.bus.open()
    assert all(sample.valid and not sample.fault for sample in r.tick().values())
    r.bus.enable(r.bus.axes)
    r.tick(5)
    assert [r.emulator.servo(i).position_ticks for i in (1, 2, 3, 4)] == pytest.approx(stopped, abs=1)
