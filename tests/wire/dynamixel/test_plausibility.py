"""Motion that a healthy servo cannot make is a fault: jumps, jammed shafts, dead encoders."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.packets import Instruction, build
from contid_drivers.dynamixel.plausibility import FollowingError, has_jumped

pytestmark = pytest.mark.realtime

TICK = reg.RAD_PER_TICK
Make = Callable[..., Any]
CLEAR_TURNS = b"\x01\x44\x58\x4c\x22"


def drive(r: Any, seconds: float, axis: str = "a1", to: float = 20000.0) -> float:
    """Command a far goal until there is a fault; returns the time it took."""
    start = time.monotonic()
    while time.monotonic() - start < seconds and not r.tick(**{axis: to * TICK})[f"r.{axis}"].fault:
        time.sleep(0.004)
    return time.monotonic() - start


def test_a_jump_of_one_turn_is_a_fault_in_the_same_exchange_and_clear_fault_finds_the_turn(rig: Make) -> None:
    r = rig(2, servo={"position_ticks": 500.0})
    r.bus.open()
    r.bus.enable(r.bus.axes)
    r.tick(a1=9000 * TICK)
    r.until(lambda: r.emulator.servo(1).position_ticks == 9000 and not r.emulator.servo(1).motion.velocity)
    known = r.tick()["r.a1"].value
    # Another host on the bus clears the count of turns; the marks in RAM survive.
    r.opened.client.port.send(build(1, Instruction.CLEAR, CLEAR_TURNS))
    time.sleep(0.01)
    sample = r.tick()["r.a1"]
    assert "its position jumped by -720 deg" in sample.fault
    assert not sample.valid
    assert sample.value == known
    r.tick(3, a1=9500 * TICK)
    assert r.emulator.servo(1).position_ticks == pytest.approx(9000, abs=1)
    r.bus.clear_fault(["r.a1"])
    assert r.tick()["r.a1"].value == pytest.approx(9000 * TICK, abs=2 * TICK)


def test_a_jump_with_an_alert_is_a_fault_with_its_cause(rig: Make) -> None:
    """An encoder that fails does both at once; the cause is not in the block of this exchange."""
    r = rig(1, servo={"position_ticks": 500.0}, telemetry_every=1000)
    r.bus.open()
    r.bus.enable(r.bus.axes)
    r.tick(3)
    r.emulator.set("jump", 1, degrees=400)
    r.emulator.set("alert", 1, bits=0x08)
    assert "encoder fault" in r.tick()["r.a1"].fault
    assert "encoder fault" in r.tick()["r.a1"].fault


def test_a_jammed_shaft_is_a_fault_and_is_no_longer_pushed(rig: Make) -> None:
    r = rig(2, axis={"current_limit_ma": 600})
    r.bus.open()
    r.bus.enable(r.bus.axes)
    r.tick(a1=20000 * TICK)
    time.sleep(0.1)
    r.emulator.set("jam", 1)
    assert 0.4 < drive(r, 3.0) < 2.0
    sample = r.tick()["r.a1"]
    assert "does not follow" in sample.fault
    assert "600 mA" in sample.fault
    r.tick(3)
    assert abs(r.emulator.servo(1).motion.current) < 100
    assert r.tick()["r.a2"].fault == ""


def test_a_dead_encoder_is_a_fault(rig: Make) -> None:
    r = rig(1, axis={"current_limit_ma": 600})
    r.bus.open()
    r.bus.enable(r.bus.axes)
    r.emulator.set("freeze", 1)
    assert drive(r, 3.0, to=6000.0) < 2.0
    assert "dead encoder" in r.tick()["r.a1"].fault


def test_a_servo_that_drives_away_at_its_own_low_limit_is_a_fault(rig: Make) -> None:
    """It pushes: the limit that counts is the one in the servo, where the robot file has none."""
    r = rig(1)
    servo = r.emulator.servos[0]
    servo.put(reg.CURRENT_LIMIT, 300)
    servo.motion.load = lambda: -200.0
    r.bus.open()
    r.bus.enable(r.bus.axes)
    r.emulator.set("share", 1, share=-1.0)
    assert drive(r, 3.0, to=6000.0) < 2.0
    assert "does not follow" in r.tick()["r.a1"].fault


def test_a_long_motion_and_a_slow_one_are_no_faults(rig: Make) -> None:
    r = rig(2, axis={"profile_velocity_deg_s": 40})
    r.bus.open()
    r.bus.enable(r.bus.axes)
    assert drive(r, 2.0, to=8000.0) >= 2.0
    assert r.tick()["r.a1"].fault == ""


def test_the_current_based_mode_may_push(rig: Make) -> None:
    r = rig(1, axis={"mode": "current_based_position", "goal_current_ma": 200})
    r.bus.open()
    r.bus.enable(r.bus.axes)
    r.emulator.set("jam", 1)
    assert drive(r, 1.2) >= 1.2


@pytest.mark.parametrize("elapsed_s", [0.001, 0.005, 0.05])
def test_a_turn_is_a_jump_and_the_fastest_motion_is_none(elapsed_s: float) -> None:
    assert has_jumped(2 * 3.14159, elapsed_s)
    assert not has_jumped(383 / 60 * 2 * 3.14159 * elapsed_s, elapsed_s)


def test_progress_restarts_the_time_of_the_following_error() -> None:
    check = FollowingError(0.5, 0.3)
    assert not any(check.is_exceeded(3.0 - 0.02 * k, 0.0, 1.0, 0.01 * k) for k in range(100))
    assert [check.is_exceeded(1.0, 5.0, 0.9, 1.0 + 0.1 * k) for k in range(5)][-1]
    assert not any(check.is_exceeded(1.0, 5.0, 0.1, 2.0 + 0.1 * k) for k in range(9))
