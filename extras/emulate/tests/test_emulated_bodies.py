"""Mechanical faults of emulated servos: where the shaft goes, and what the watch makes of it."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import pytest

from contid.control.tick.faults import Fault
from contid.robot_file.load import find_robot_file, load_robot_file
from contid_drivers.dynamixel import registers as reg
from contid_emulate.dynamixel import InjectedFault
from contid_emulate.dynamixel.motion import ShaftMotion
from contid_emulate.dynamixel.servo import Servo
from tests.campaign.bodies.motions import motion
from tests.campaign.bodies.plants import RATE_HZ, STEP_S, STEPS, axes_of
from tests.campaign.bodies.watched_runs import Watched


def turned(shaft: ShaftMotion, goal: float, seconds: float = 2.0) -> ShaftMotion:
    shaft.goal = goal
    for _ in range(round(seconds / STEP_S)):
        shaft.step(STEP_S)
    return shaft


def shaft_at(position: float = 1000.0) -> ShaftMotion:
    shaft = ShaftMotion(position, (-5000.0, 5000.0))
    shaft.limit(4000.0, 40_000.0, 1750.0)
    return shaft


def test_the_loop_closes_over_an_encoder_that_sees_a_third() -> None:
    shaft = shaft_at()
    shaft.see(1.0 / 3.0)
    turned(shaft, 1300.0)
    assert shaft.seen == pytest.approx(1300.0, abs=1.0)
    assert shaft.position == pytest.approx(1900.0, abs=3.0)


def test_a_wrong_sign_leads_to_a_stop_and_an_overload() -> None:
    shaft = shaft_at()
    shaft.see(-1.0)
    turned(shaft, 1010.0, 6.0)
    assert shaft.position == shaft.stops[1]
    assert shaft.overloaded


def test_a_jump_of_the_encoder_turns_the_shaft_back() -> None:
    shaft = turned(shaft_at(), 1200.0)
    shaft.jumped = 300.0
    assert shaft.seen == 1500.0
    assert turned(shaft, 1200.0).position == 900.0
    shaft.release()
    assert turned(shaft, shaft.goal).position == 900.0  # torque off and on: it stays


def test_a_slow_shaft_has_a_share_of_its_top_speed() -> None:
    shaft = shaft_at()
    shaft.slowed = 0.05
    shaft.limit(4000.0, 40_000.0, 1750.0)
    turned(shaft, 4000.0, 1.0)
    assert shaft.velocity == pytest.approx(0.05 * 103.0 / 60.0 * 4096.0)


def test_a_servo_reports_what_its_encoder_sees() -> None:
    servo = Servo(1, position_ticks=2000.0)
    servo.motion.jumped = 100.0
    assert servo.present() == 2100


@pytest.mark.parametrize("kind", ["share", "slow"])
def test_a_share_needs_a_servo(kind: str) -> None:
    assert InjectedFault.model_validate({"fault": kind, "id": 3, "share": 0.3}).share == 0.3
    with pytest.raises(ValueError, match="needs an id"):
        InjectedFault.model_validate({"fault": kind, "share": 0.3})


@pytest.mark.parametrize(
    ("damage", "faults"),
    [
        (lambda shaft: None, {Fault.NONE}),
        (lambda shaft: shaft.see(-1.0), {Fault.DOES_NOT_FOLLOW, Fault.MOVES_UNASKED}),
        (lambda shaft: setattr(shaft, "jumped", 1500.0), {Fault.IMPLAUSIBLE_SAMPLE}),
        (lambda shaft: setattr(shaft, "slowed", 0.01), {Fault.DOES_NOT_FOLLOW}),
    ],
    ids=["sound", "wrong sign", "jump", "slow"],
)
def test_the_watch_finds_what_an_encoder_shows(
    damage: Callable[[ShaftMotion], None], faults: set[Fault]
) -> None:
    """Not a share of a third: the loop hides it while its speed lasts, and only a tracker shows it."""
    axes = axes_of(load_robot_file(find_robot_file("finger")))[0]
    moves, config = motion(axes.config, random.Random(3)), axes.config
    device = config.transmission.to_device(next(moves))
    shafts = [ShaftMotion(each / reg.RAD_PER_TICK, (-math.inf, math.inf)) for each in device]
    watched = Watched(axes)
    for tick in range(1200):
        watched.tick(tick, device, [round(each.seen) * reg.RAD_PER_TICK for each in shafts])
        if watched.fault is not Fault.NONE:
            break
        if tick == 400:
            damage(shafts[0])
        for shaft, goal in zip(shafts, device, strict=True):
            shaft.goal = goal / reg.RAD_PER_TICK
            shaft.limit(math.inf, 0.0, 1750.0)
            for _ in range(STEPS):
                shaft.step(1.0 / RATE_HZ / STEPS)
        device = config.transmission.to_device(next(moves))
    assert watched.fault in faults, watched.message
