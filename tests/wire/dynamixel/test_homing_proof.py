"""A standstill alone is no reference: frozen encoders, jams, obstacles, slips, and zeros that moved."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from contid.errors import DeviceError
from contid.hal import Reference
from contid_drivers.dynamixel import DRIVER, turns
from contid_drivers.dynamixel import registers as reg
from contid_emulate.dynamixel import Servo, TendonPlant

pytestmark = pytest.mark.realtime

Make = Callable[..., Any]
TICK = reg.RAD_PER_TICK
STOP = {"method": "hard_stop", "direction": -1, "current_ma": 120, "speed_deg_s": 360, "timeout_s": 6}
TENSION = {"method": "tension", "direction": 1, "current_ma": 120, "speed_deg_s": 180, "timeout_s": 20}
STOP_TICKS = -300.0


def quiet(line: str) -> None:
    """Ignore the report."""


def home(r: Any, report: Callable[[str], None] = quiet, zero_deg: float | None = None) -> Any:
    """Home all axes; with a former zero all have it."""
    zero = None if zero_deg is None else math.radians(zero_deg)
    axes = [replace(axis, reference=Reference(zero)) for axis in r.axes]
    return DRIVER.home("servos", r.options, axes, [a.name for a in axes], report)  # type: ignore[attr-defined]


def marked(servo: Servo) -> bool:
    """Whether the servo counts as homed."""
    return abs(servo.get(turns.MARKER) - 145) <= turns.TURNS_MAX


def power_cycle(r: Any) -> None:
    """The servo loses its count, and answers again."""
    r.emulator.set("brownout", 1)
    time.sleep(0.3)


@pytest.mark.parametrize("fault", ["freeze", "jam"])
def test_what_does_not_move_back_is_no_stop(rig: Make, fault: str) -> None:
    r = rig(1, axis={"homing": STOP}, servo={"stops_ticks": (STOP_TICKS, 1e9), "position_ticks": 700.0})
    r.emulator.set(fault, 1, on=True)
    with pytest.raises(DeviceError, match=r"r\.a1.*does not move back.*jammed shaft or a dead encoder"):
        home(r)
    assert not r.emulator.servo(1).torque
    assert not marked(r.emulator.servo(1))


def test_an_obstacle_that_goes_away_is_no_stop(rig: Make) -> None:
    r = rig(1, axis={"homing": STOP}, servo={"stops_ticks": (200.0, 1e9), "position_ticks": 700.0})
    servo = r.emulator.servo(1)

    def free(line: str) -> None:
        if "once more" in line:
            servo.motion.stops = (STOP_TICKS, 1e9)

    with pytest.raises(DeviceError, match="stood still at two places"):
        home(r, free)
    assert not marked(servo)


def test_a_host_that_pauses_longer_than_the_watchdog_of_a_run_still_homes(rig: Make) -> None:
    r = rig(1, axis={"homing": STOP}, servo={"stops_ticks": (STOP_TICKS, 1e9)}, watchdog_ms=40)
    (found,) = home(r, lambda line: time.sleep(0.1 if "once more" in line else 0.0))
    assert found.value == pytest.approx(
        (STOP_TICKS + r.emulator.servo(1).count_offset()) * TICK, abs=3 * TICK
    )


@pytest.mark.parametrize("counted", [True, False])
def test_a_zero_that_moved_is_refused_and_given_up_by_force(rig: Make, counted: bool) -> None:
    r = rig(1, axis={"homing": STOP}, servo={"stops_ticks": (STOP_TICKS, 1e9), "position_ticks": 700.0})
    servo = r.emulator.servo(1)
    (found,) = home(r)
    if not counted:
        power_cycle(r)
    # 58 mm of a rack of 37.7 mm per turn, as the issue has it.
    servo.motion.stops = (STOP_TICKS + 58.0 / 37.7 * 4096, 1e9)
    servo.motion.position = servo.motion.goal = servo.motion.stops[0] + 500.0
    with pytest.raises(DeviceError, match="its zero moved by"):
        home(r, zero_deg=math.degrees(found.value))
    assert marked(servo) is counted  # the former count, if it was valid
    (moved,) = home(r)
    assert marked(servo)
    off = moved.value - found.value - (0.0 if counted else servo.count_offset() * TICK)
    assert math.remainder(off - 58.0 / 37.7 * math.tau, math.tau) == pytest.approx(0.0, abs=3 * TICK)


def test_the_same_stop_after_a_power_cycle_is_the_same_zero(rig: Make) -> None:
    r = rig(1, axis={"homing": STOP}, servo={"stops_ticks": (STOP_TICKS, 1e9), "position_ticks": 700.0})
    (found,) = home(r)
    servo = r.emulator.servo(1)
    servo.motion.position = servo.motion.goal = 3 * 4096 + 100.0
    power_cycle(r)
    (again,) = home(r, zero_deg=math.degrees(found.value))
    assert again.value - found.value == pytest.approx(-3 * math.tau, abs=3 * TICK)


@pytest.mark.parametrize("fault", ["freeze", "jam"])
def test_a_spool_that_does_not_move_back_is_not_tensioned(rig: Make, fault: str) -> None:
    made = [Servo(i + 1, position_ticks=-300.0 - 50 * i) for i in range(3)]
    TendonPlant(made, (1,) * 3, (0.0,) * 3, (2.0,) * 3)
    r = rig(3, axis={"homing": TENSION}, made=made)
    r.emulator.set(fault, 2, on=True)
    with pytest.raises(DeviceError, match=r"r\.a2.*does not move back"):
        home(r)
    assert not any(servo.torque or marked(servo) for servo in made)
