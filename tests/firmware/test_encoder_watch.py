"""The board compares a motor's count with its drive: broken encoders, healthy shafts, homing."""

from __future__ import annotations

import math
import os
import random
import subprocess

import pytest

from contid_devices.due.firmware_build import WARNINGS, build_once, firmware_dir
from contid_drivers.due import messages
from contid_drivers.due.codes import BoardState, Reason, Type
from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.host import Host
from tests.firmware.sam3x.plant import Motors
from tests.firmware.shafts.trials import DEGREE, FAULTS, HERE, run

pytestmark = pytest.mark.process

SWITCHES = {
    "encoder_stuck": Reason.STALLED,
    "encoder_track_a": Reason.ENCODER_TRACK,
    "encoder_track_b": Reason.ENCODER_TRACK,
    "encoder_reversed": Reason.ENCODER_REVERSED,
}
TRIALS = 20
CAMPAIGN = int(os.environ.get("CONTID_SHAFTS", "1000"))


def follow(motors, speed_deg_s, ms):
    """A streamed line from where the shaft is; the farthest way of the shaft until the board noticed."""
    motors.demand()
    start = motors.truth(0)[0]
    zero = motors.telemetry.channels[0].position
    since, farthest = motors.telemetry.uptime_ms, 0.0
    for _ in range(ms // 5):
        goal = zero + speed_deg_s * DEGREE * (motors.telemetry.uptime_ms - since) / 1000
        motors.demand({0: round(goal)}, velocities={0: round(speed_deg_s * DEGREE)})
        motors.step(5)
        if motors.telemetry.channels[0].state is BoardState.SAFE:
            break
        farthest = max(farthest, abs(motors.truth(0)[0] - start))
    return farthest / DEGREE


@pytest.mark.parametrize("switch", SWITCHES)
@pytest.mark.parametrize("speed_deg_s", [3, 30, 300])
@pytest.mark.parametrize("moving", [False, True])
def test_a_broken_encoder_of_the_emulated_board(board, switch, speed_deg_s, moving):
    motors = board("motor")
    motors.configure({"m0": {}})
    motors.arm(0)
    if moving:
        follow(motors, speed_deg_s, 500)
    motors.command(f"set 0 {switch} 1")
    way_deg = follow(motors, speed_deg_s, 4000)
    assert motors.trip()["reason"] == SWITCHES[switch].name.lower()
    assert way_deg <= (15 if speed_deg_s >= 30 else 30)


@pytest.mark.slow
@pytest.mark.parametrize("speed_deg_s", [pytest.param(10, marks=pytest.mark.campaign), 100])
def test_an_open_track_at_the_pins_of_the_sketch(speed_deg_s):
    """The sketch's machine code on an emulated chip, down to the pin interrupt that counts."""
    chip = Sam3x(build_sketch())
    chip.run_ms(25)
    chip.usb.open()
    plant, host = Motors(chip), Host(chip.ask_usb)
    host.configure(3)
    host.arm(3)
    host.demand({})
    start = 0.0
    for ms in range(0, 900, 10):
        if ms == 100:
            plant.open(2)
            start = plant.shaft[2]
        host.demand({2: round(speed_deg_s * DEGREE * ms / 1000)})
        chip.run_ms(10)
        assert host.telemetry is not None
        if host.telemetry.channels[2].state is BoardState.SAFE:
            break
    assert host.telemetry is not None
    assert host.telemetry.channels[2].reason is Reason.ENCODER_TRACK
    assert abs(plant.shaft[2] - start) / DEGREE <= (15 if speed_deg_s >= 30 else 30)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("mode", ["armed", "homing"])
@pytest.mark.parametrize(
    "trials", [TRIALS, pytest.param(CAMPAIGN, marks=[pytest.mark.campaign, pytest.mark.slow])]
)
def test_random_onsets(mode, fault, trials):
    """Motors of 10 ms, 20 % faster than their file, are the few that go on a little farther."""
    done = run(mode, fault, trials)
    assert sum(one.reason is Reason.NONE and one.state is BoardState.ARMED for one in done) <= trials / 250
    above = [one for one in done if one.at_fault_deg > one.limit_deg]
    assert len(above) <= max(1, trials / 200), [one.line for one in above]
    assert all(one.at_fault_deg <= one.limit_deg + 10 for one in above), [one.line for one in above]


@pytest.mark.parametrize(
    "trials", [60, pytest.param(5 * CAMPAIGN, marks=[pytest.mark.campaign, pytest.mark.slow])]
)
@pytest.mark.parametrize("mode", ["healthy", "homing"])
def test_healthy_shafts_are_left_alone(mode, trials):
    """Ten seconds of lines, waves, steps, pauses and short blocks each; or a search of the end stop."""
    done = run(mode, "none", trials, seed=2)
    assert [one.line for one in done if one.reason is not Reason.NONE] == []


@pytest.mark.parametrize("blocked_ms", [20, 100, 1000])
def test_a_shaft_that_was_blocked_below_the_stall_goes_on(board, blocked_ms):
    motors = board("motor")
    motors.configure({"m0": {"stall_percent": 40}})
    motors.arm(0)
    follow(motors, 30, 500)
    motors.command("set 0 stall 1")
    zero = motors.demand().channels[0].position
    for _ in range(blocked_ms // 5):
        motors.demand({0: zero})  # it is asked to stay about where it is
        motors.step(5)
    motors.command("set 0 stall 0")
    follow(motors, 30, 500)
    assert motors.telemetry.channels[0].state is BoardState.ARMED


def test_the_stall_current_excuses_a_block_until_stall_ms(board):
    motors = board("motor")
    motors.configure({"m0": {"stall_current_ma": 500, "stall_ms": 400}})
    motors.arm(0)
    follow(motors, 100, 500)
    motors.command("set 0 stall 1")
    began = motors.telemetry.uptime_ms
    follow(motors, 100, 200)
    assert motors.telemetry.channels[0].state is BoardState.ARMED
    follow(motors, 100, 800)
    assert motors.trip()["reason"] == "stalled"
    assert 380 <= motors.trip()["world_ms"] - began <= 500


@pytest.mark.parametrize("fault", ["", "encoder_stuck", "encoder_track_a", "encoder_track_b", "stall"])
@pytest.mark.parametrize("at_ms", [0, 300, 420, 700])
def test_homing_never_exceeds_its_duty(board, fault, at_ms):
    """Approach and way back; a broken encoder ends it soon."""
    motors = board("motor")
    motors.configure({"m0": {"homing": {"direction": 1, "speed_deg_s": 90, "duty_percent": 30}}})
    motors.command("set 0 high 900")
    motors.command("set 0 low -1e9")
    motors.demand()
    motors.masked(Type.HOME, 0)
    most = 0.0
    for ms in range(0, 4000, 2):
        if fault and ms == at_ms:
            motors.command(f"set 0 {fault} 1")
        if ms % 10 == 0:
            motors.demand()
        motors.step(2)
        _, _, _, _, drive, duty, _ = motors.truth(0)
        if motors.telemetry.channels[0].state is not BoardState.HOMING:
            break
        most = max(most, abs(duty) if drive == 2 else 0)
    assert most <= math.ceil(0.30 * 32767)
    report = motors.demand().channels[0]
    assert (report.state, report.homed) == ((BoardState.SAFE, False) if fault else (BoardState.STOPPED, True))
    if fault:
        assert ms - at_ms < 600


def test_an_open_track_between_the_searches_is_no_stop(board):
    motors = board("motor")
    motors.configure({"m0": {"homing": {"direction": 1, "speed_deg_s": 90}}})
    motors.command("set 0 encoder_track_a 1")
    motors.demand()
    motors.masked(Type.HOME, 0)
    for _ in range(200):
        motors.demand()
        motors.step(5)
    assert motors.trip()["reason"] in ("encoder_track", "stalled")
    motors.masked(Type.CLEAR, 0)
    assert isinstance(motors.arm(0), messages.Refused)


def test_the_square_root_of_the_profile_is_exact():
    program = build_once(
        "roots", ["g++", "-std=gnu++11", *WARNINGS, f"-I{firmware_dir()}"], [HERE / "roots.cpp"], []
    )
    rng = random.Random(3)
    values = [rng.getrandbits(64) >> rng.randrange(64) for _ in range(5000)]
    squares = [(rng.getrandbits(32) >> rng.randrange(31)) ** 2 for _ in range(2000)]
    values += [
        *range(300),
        2**63,
        2**64 - 1,
        *squares,
        *(one - 1 for one in squares if one),
        *(one + 1 for one in squares),
    ]
    done = subprocess.run(
        [program], input="\n".join(map(str, values)), capture_output=True, text=True, check=True
    )
    assert [int(line) for line in done.stdout.split()] == [math.isqrt(value) for value in values]
