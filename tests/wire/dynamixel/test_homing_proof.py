"""A standstill alone is no reference: frozen encoders, jams, obstacles, slips, and zeros that moved.

Disturbed searches run in virtual time.
"""

from __future__ import annotations

import math
import os
import random
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import pytest

from contid.errors import DeviceError
from contid.hal import Reference
from contid_devices.dynamixel import TOOLS, homing, search, tensioning
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel import turns
from contid_emulate.dynamixel import Servo, TendonPlant
from tests.wire.dynamixel.virtual_wire import servo_time
from tests.wire.wire_time import WireTime

pytestmark = pytest.mark.realtime

Make = Callable[..., Any]
TICK = reg.RAD_PER_TICK
HOMINGS = int(os.environ.get("CONTID_HOMINGS", "8"))
STOP = {"method": "hard_stop", "direction": -1, "current_ma": 120, "speed_deg_s": 360, "timeout_s": 6}
TENSION = {"method": "tension", "direction": 1, "current_ma": 120, "speed_deg_s": 180, "timeout_s": 20}
STOP_TICKS = -300.0


def quiet(line: str) -> None:
    """Ignore the report."""


def home(r: Any, report: Callable[[str], None] = quiet, zero_deg: float | None = None) -> Any:
    """Home all axes; with a former zero all have it."""
    zero = None if zero_deg is None else math.radians(zero_deg)
    axes = [replace(axis, reference=Reference(zero)) for axis in r.axes]
    return TOOLS.home("servos", r.options, axes, [a.name for a in axes], report)


def marked(servo: Servo) -> bool:
    """Whether the servo counts as homed."""
    return abs(servo.get(turns.LAST_ADDRESS) - 145) <= turns.TURNS_MAX


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


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> WireTime:
    return servo_time(monkeypatch, homing, search, tensioning)


@dataclass(frozen=True)
class Trouble:
    """One disturbance of a homing: what, and when [s]."""

    kind: str
    at_s: float
    until_s: float
    ticks: float


def troubles(seed: int, kinds: Iterable[str], span_s: float) -> list[Trouble]:
    rng, kinds = random.Random(seed), tuple(kinds)
    found = []
    for number in range(HOMINGS):
        at_s = rng.uniform(0.0, span_s)
        until_s = at_s + rng.choice((rng.uniform(0.05, 1.5), 60.0))
        ticks = rng.choice((-1, 1)) * rng.uniform(5, 3000)
        found.append(Trouble(kinds[number % len(kinds)], at_s, until_s, ticks))
    return found


class Disturbed:
    """One servo that is disturbed at its time (`tests.wire.wire_time.Emulated`)."""

    def __init__(self, r: Any, device: int, trouble: Trouble, now_s: float) -> None:
        self.emulator, self.device, self.trouble = r.emulator, device, trouble
        self.servo: Servo = r.emulator.servo(device)
        self.due = [(now_s + trouble.at_s, True), (now_s + trouble.until_s, False)]

    def turn(self, now_s: float) -> None:
        while self.due and now_s >= self.due[0][0]:
            self.switch(self.due.pop(0)[1])

    def switch(self, on: bool) -> None:
        motion, ticks = self.servo.motion, self.trouble.ticks
        if self.trouble.kind in ("freeze", "jam"):
            self.emulator.set(self.trouble.kind, self.device, on=on)
        elif self.trouble.kind == "obstacle":
            low = max(motion.stops[0], motion.position - abs(ticks) % 400) if on else STOP_TICKS
            motion.stops = (low, motion.stops[1])
        elif on:
            # Shaft and load against the encoder: the count stays, the load and its stops move.
            self.servo.forgotten_ticks += round(ticks)


@pytest.mark.parametrize("trouble", troubles(7, ("freeze", "jam", "slip", "obstacle"), 3.0), ids=repr)
def test_a_disturbed_search_of_a_stop_gives_its_zero_or_an_error(
    rig: Make, clock: WireTime, trouble: Trouble
) -> None:
    r = rig(
        1,
        axis={"homing": STOP},
        servo={"stops_ticks": (STOP_TICKS, 1e9), "position_ticks": 3000.0},
        time=clock,
    )
    servo = r.emulator.servo(1)
    true: list[float] = []

    def report(line: str) -> None:
        if "stop at" in line:  # the second finding: the shaft has not left it for longer than its way back
            true.append((STOP_TICKS + servo.count_offset()) * TICK)

    clock.devices = (*clock.devices, Disturbed(r, 1, trouble, clock.now()))
    # What stays in the way for ever is recognised by the former zero alone.
    zero = None if trouble.kind == "slip" else math.degrees((STOP_TICKS + servo.count_offset()) * TICK)
    try:
        (found,) = home(r, report, zero)
    except DeviceError:
        assert not servo.torque
        return
    late_slip = trouble.kind == "slip" and abs(
        found.value - true[0] + round(trouble.ticks) * TICK
    ) < math.radians(1)
    assert abs(found.value - true[0]) < math.radians(1.0) + 2 * TICK or late_slip


@pytest.mark.parametrize("trouble", troubles(4, ("freeze", "jam"), 4.0), ids=repr)
def test_disturbed_tensioning_gives_its_zeros_or_an_error(
    rig: Make, clock: WireTime, trouble: Trouble
) -> None:
    made = [Servo(i + 1, position_ticks=-300.0 - 50 * i) for i in range(3)]
    TendonPlant(made, (1,) * 3, (0.0,) * 3, (2.0,) * 3)
    for servo in made:
        servo.memory[9] = 0
    r = rig(3, axis={"homing": TENSION}, made=made, time=clock)
    clock.devices = (*clock.devices, Disturbed(r, 2, trouble, clock.now()))
    try:
        found = home(r)
    except DeviceError:
        assert not any(servo.torque for servo in made)
        return
    for each, servo in zip(found, made, strict=True):
        # 120 mA less 40 of friction over 2 mA per tick; 2 mm of a spool of 20 mm are 131 ticks.
        assert abs(each.value / TICK - servo.count_offset() - 40.0) < 131.0
