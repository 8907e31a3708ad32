"""Homing of servos that jam, freeze, slip and meet obstacles: its zero, or an error; in virtual time."""

from __future__ import annotations

import math
import os
import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import pytest

from contid.errors import DeviceError
from contid_drivers.dynamixel import homing, search, tensioning
from contid_emulate.dynamixel import Servo, TendonPlant
from tests.wire.dynamixel.test_homing_proof import STOP, STOP_TICKS, TENSION, TICK, home
from tests.wire.dynamixel.virtual_wire import servo_time
from tests.wire.wire_time import WireTime

Make = Callable[..., Any]
HOMINGS = int(os.environ.get("CONTID_HOMINGS", "8"))


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


@pytest.mark.parametrize("trouble", troubles(8, ("freeze", "jam"), 4.0), ids=repr)
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
