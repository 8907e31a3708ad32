"""The grip: a share of the current limit, live, so that an egg is held and not crushed."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contid.control.engine.wiring import wired_buses
from contid.hal import LimitsEffort
from contid.robot_file.load import load_robot_file
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.grip import EVERY
from contid_emulate.dynamixel import DynamixelEmulator
from contid_emulate.dynamixel.bench import Bench
from tests.support.command import contid_in

pytestmark = pytest.mark.realtime

GRIP = {"mode": "current_based_position", "goal_current_ma": 600}
#: The egg breaks when it is pushed with more than this.
EGG_MA = 250.0


def put_egg(emulator: DynamixelEmulator, device: int, ahead_ticks: float = 300.0) -> Any:
    """An egg ahead of a servo; returns its motion."""
    motion: Any = emulator.servo(device).motion
    motion.stops = (motion.stops[0], motion.position + ahead_ticks)
    motion.crushed, step = False, motion.step

    def press(dt: float) -> None:
        step(dt)
        if abs(motion.current) > EGG_MA:
            motion.crushed, motion.stops = True, (-math.inf, math.inf)

    motion.step = press
    return motion


def squeeze(r: Any, seconds: float = 1.0) -> dict[str, Any]:
    """Close the first axis beyond the egg for a while; its last sample."""
    goal = r.tick()["r.a1"].value + 1.5
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        samples = r.tick(a1=goal)
        time.sleep(0.005)
    return dict(samples)


def test_an_egg_is_held_with_a_share_of_the_current_and_crushed_with_all_of_it(
    rig: Callable[..., Any],
) -> None:
    r = rig(1, axis=GRIP)
    r.bus.open()
    r.bus.enable(r.bus.axes)
    assert isinstance(r.bus, LimitsEffort)
    assert r.bus.effort_limits() == {"r.a1": 0.6}
    r.bus.limit_effort({"r.a1": 0.3})
    egg = put_egg(r.emulator, 1)
    sample = squeeze(r)["r.a1"]
    assert not egg.crushed
    assert sample.effort == pytest.approx(0.18, abs=0.001)
    assert r.emulator.servo(1).get(reg.GOAL_CURRENT) == 180
    r.bus.limit_effort({"r.a1": 1.0})
    squeeze(r, 0.5)
    assert egg.crushed


def test_a_servo_that_missed_the_change_gets_it_again(rig: Callable[..., Any]) -> None:
    r = rig(2, axis=GRIP)
    r.bus.open()
    r.bus.enable(r.bus.axes)
    r.bus.limit_effort({"r.a1": 0.5, "r.a2": 0.25})
    r.tick(times=5)
    assert [r.emulator.servo(i).get(reg.GOAL_CURRENT) for i in (1, 2)] == [300, 150]
    r.emulator.servo(2).put(reg.GOAL_CURRENT, 600)
    r.tick(times=EVERY)
    assert r.emulator.servo(2).get(reg.GOAL_CURRENT) == 150


def test_arming_again_keeps_the_share(rig: Callable[..., Any]) -> None:
    from contid.hal import Rest

    r = rig(1, axis=GRIP)
    r.bus.open()
    r.bus.limit_effort({"r.a1": 0.5})
    r.bus.enable(r.bus.axes)
    assert r.emulator.servo(1).get(reg.GOAL_CURRENT) == 300
    r.bus.disable(r.bus.axes, Rest.RELAX)
    r.bus.enable(r.bus.axes)
    assert r.emulator.servo(1).get(reg.GOAL_CURRENT) == 300


@pytest.mark.parametrize(
    ("left_ma", "own_ma", "axis", "expected_ma"),
    [
        (180, 1750, {}, 1750),  # the grip of an earlier run
        (180, 1750, {"current_limit_ma": 600}, 600),
        (1750, 1750, {"current_limit_ma": 600}, 600),
        (500, 500, {}, 500),  # its owner's limit, below that of the model
    ],
)
def test_arming_sets_the_current_that_the_file_means(
    rig: Callable[..., Any], left_ma: int, own_ma: int, axis: dict[str, Any], expected_ma: int
) -> None:
    r = rig(1, axis={"mode": "current_based_position", **axis})
    servo = r.emulator.servo(1)
    servo.put(reg.OPERATING_MODE, 5)
    servo.put(reg.CURRENT_LIMIT, own_ma)
    servo.put(reg.GOAL_CURRENT, left_ma)
    r.bus.open()
    r.bus.enable(r.bus.axes)
    assert servo.get(reg.GOAL_CURRENT) == expected_ma
    # A share of more than the servo's own limit would be refused, without an answer.
    r.bus.limit_effort({"r.a1": 0.5})
    r.tick(times=2)
    assert servo.get(reg.GOAL_CURRENT) == expected_ma // 2


def test_axes_in_another_mode_have_no_limit(rig: Callable[..., Any]) -> None:
    r = rig(1)
    r.bus.open()
    assert r.bus.effort_limits() == {}


@pytest.mark.process
def test_the_grip_of_a_running_robot_changes_live(tmp_path: Path, configs: Path) -> None:
    text = (configs / "hand.emulated.yaml").read_text().replace("./hand.tty", str(tmp_path / "hand.tty"))
    text = text.replace(
        "    baud: 1000000\n", "    baud: 1000000\n    usb_latency_ms: 15\n    watchdog_ms: 400\n"
    )
    for device in (1, 2):
        text = text.replace(
            f"id: {device},", f"id: {device}, mode: current_based_position, goal_current_ma: 500,"
        )
    (tmp_path / "hand.yaml").write_text(text)
    (bus,) = wired_buses(load_robot_file(tmp_path / "hand.yaml"))
    bench = Bench(bus.wiring.name, bus.wiring.options, bus.axes)  # type: ignore[arg-type]
    with bench:
        run = subprocess.Popen(
            [sys.executable, "-m", "contid", "run", "hand.yaml", "--socket", "s.sock", "--json"],
            cwd=tmp_path, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True,
            env=os.environ.copy(),
        )  # fmt: skip
        try:
            until = time.monotonic() + 90.0
            while "HOLD" not in contid_in(tmp_path, "status", "--socket", "s.sock", "--json").stdout:
                assert time.monotonic() < until
            done = contid_in(tmp_path, "move", "left", "--grip", "0.3", "--socket", "s.sock", "--json")
            assert json.loads(done.stdout)["share"] == 0.3
            servos = bench.emulator.servos
            until = time.monotonic() + 30.0
            while [servo.get(reg.GOAL_CURRENT) for servo in servos] != [150, 150, 1750, 1750]:
                assert time.monotonic() < until
                time.sleep(0.05)
            refused = contid_in(tmp_path, "move", "right", "--grip", "0.3", "--socket", "s.sock")
            assert refused.returncode != 0
            assert "none of its axes is in a mode that limits its effort" in refused.stderr
            assert contid_in(tmp_path, "move", "left", "--grip", "1.5", "--socket", "s.sock").returncode == 2
        finally:
            run.send_signal(signal.SIGINT)
            out, _ = run.communicate(timeout=20)
    assert json.loads(out)["exit_code"] == 0 or "interrupt" in json.loads(out)["ending"]


def test_a_crash_with_a_grip_does_not_refuse_the_next_run(rig: Callable[..., Any]) -> None:
    r = rig(1, axis=GRIP)
    r.bus.open()
    r.bus.enable(["r.a1"])
    r.bus.limit_effort({"r.a1": 0.3})
    put_egg(r.emulator, 1)
    squeeze(r, 0.3)
    r.emulator.set("trip", 1)
    r.as_another_process()
    r.bus.open()
    r.bus.enable(["r.a1"])
    assert not r.tick()["r.a1"].fault
    assert r.emulator.servo(1).get(reg.GOAL_CURRENT) == 600
    assert not r.emulator.servo(1).tripped
