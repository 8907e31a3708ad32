"""Load cells on the boards: the floor of tension, slack and snap, cells that fail, a host that dies."""

from __future__ import annotations

import os
from typing import Any

import pytest

from contid_drivers.due import messages
from contid_drivers.due.codes import BoardState, Reason, Refusal, RestCode, Type
from contid_drivers.due.messages import Configured, Refused
from tests.firmware.tendons.trials import AMPLIFIER, CONVERTER, MOVES, configure, repeat, run

pytestmark = pytest.mark.process

CAMPAIGN = int(os.environ.get("CONTID_TENDONS", "100000"))
#: Counts per degree of the default gear, and a tendon of the emulator.
DEGREE = 4776 / 360.0
AXIS: dict[str, Any] = {
    "start_state": "brake",
    "tension": {**AMPLIFIER, "stiffness_n_per_deg": 0.5, "take_up_deg": 20.0},
}


def armed(board, **tension):
    """A motor board with two tendons at three times their floor, armed."""
    motors = board("motor")
    keys = {**AXIS, "tension": AXIS["tension"] | tension}
    assert isinstance(motors.configure({"m0": keys, "m1": keys}), Configured)
    motors.arm(0, 1)
    return motors


def follow(motors, ms, **goals_deg):
    for _ in range(ms // 10):
        motors.demand({int(name[1]): round(deg * DEGREE) for name, deg in goals_deg.items()})
        motors.step(10)
    motors.demand()
    return motors.telemetry.channels


# -- the floor, by a plant of its own ---------------------------------------------------------------------


def test_the_floor_is_held_through_moves():
    done = run("moves", 4, 5)
    assert {one.reason for one in done} == {Reason.NONE}
    assert min(one.least_n for one in done) >= 0.9


def test_a_capstan_that_lets_go_at_once_leaves_the_floor():
    """Its body came at 29 mm/s hidden from the cell by friction: 0.73 N before the demand counted."""
    body = configure(1, 0, 1.8493831588715213)
    (one,) = repeat([f"moves 982546469 50 0 1 1.740 {body}"])
    assert one.least_n >= 0.9


@pytest.mark.parametrize("hz", [0, 80])
def test_a_cell_that_stands_still_is_found_by_motion(hz):
    done = run("frozen", 6, 1, hz)
    assert {one.reason for one in done} == {Reason.CELL_FROZEN}


@pytest.mark.campaign
def test_the_floor_is_held_through_very_many_moves():
    done = run("moves", CAMPAIGN // (2 * MOVES), MOVES)
    assert {one.reason for one in done} == {Reason.NONE}
    assert sum(one.below for one in done) == 0


@pytest.mark.parametrize(
    ("kind", "reasons", "most_ms"),
    [
        ("cut", {Reason.SNAP}, 20),
        ("open", {Reason.CELL}, 20),
        ("saturated", {Reason.CELL}, 20),
        ("reversed", {Reason.CELL}, 20),
    ],
)
def test_what_fails_is_found_in_milliseconds(kind, reasons, most_ms):
    done = run(kind, 6, 2)
    assert {one.reason for one in done} == reasons
    assert max(one.ms for one in done) <= most_ms
    if reasons == {Reason.CELL}:
        # From the first bad reading on nothing is driven outwards.
        assert max(one.outward for one in done) == 0.0


def test_a_dead_host_leaves_the_floor():
    done = run("host", 4, 1)
    assert {(one.reason, one.state) for one in done} == {(Reason.WATCHDOG, BoardState.SAFE)}
    assert min(one.least_n for one in done) >= 0.9


# -- on the emulated board, whose bodies stand ------------------------------------------------------------


@pytest.mark.parametrize("cell", [AMPLIFIER, CONVERTER])
def test_a_demand_that_slackens_stops_at_the_floor(board, cell):
    motors = armed(board, **cell)
    channels = follow(motors, 1500, m0=-20.0)
    assert channels[0].tension_mn == pytest.approx(1100, abs=120)
    assert channels[0].limited
    assert channels[1].tension_mn == pytest.approx(3000, abs=120)
    assert not channels[1].limited
    # What tightens is followed as ever.
    assert follow(motors, 1500, m0=5.0)[0].position == pytest.approx(5 * DEGREE, abs=4)


def test_a_relaxed_motor_is_at_no_limit(board):
    motors = armed(board)
    assert follow(motors, 1500, m0=-20.0)[0].limited
    motors.ask(Type.STOP, messages.stop([0, 1], RestCode.RELAX))
    motors.step(5)
    motors.demand()
    assert not motors.telemetry.channels[0].limited


def test_a_parked_count_is_no_way_of_the_shaft(board):
    motors = armed(board)
    assert follow(motors, 1500, m0=6.0)[0].position == pytest.approx(6 * DEGREE, abs=4)
    motors.ask(Type.STOP, messages.stop([0, 1], RestCode.RELAX))
    motors.command("set 0 cell_noise 0")
    motors.step(500)  # the readings are alike to the last bit
    motors.ask(Type.PARK, messages.park(motors.crc, [0], parked=True))
    motors.step(5)
    assert not isinstance(motors.arm(0), Refused)


def test_a_telemetry_without_cells_is_as_before(board):
    motors = board("motor")
    motors.configure({"m0": {}})
    motors.demand()
    assert motors.telemetry.channels[0].tension_mn is None


@pytest.mark.parametrize("switch", ["cell_open", "cell_saturated"])
def test_a_dead_cell_is_neither_armed_nor_homed_nor_pulsed(board, switch):
    motors = board("motor")
    motors.configure({"m0": {**AXIS, "homing": {"direction": 1}}})
    motors.command(f"set 0 {switch} 1")
    motors.step(5)
    motors.demand()
    assert motors.telemetry.channels[0].tension_mn is None
    refused = motors.masked(Type.HOME, 0)
    assert isinstance(refused, Refused)
    assert refused.refusal == Refusal.NO_SENSOR
    echo = motors.telemetry.uptime_ms
    refused = motors.ask(Type.PULSE, messages.pulse(motors.crc, echo, 0, -3000, 10))
    assert isinstance(refused, Refused)
    assert refused.refusal == Refusal.NO_SENSOR
    motors.configure({"m0": AXIS})
    refused = motors.arm(0)
    assert isinstance(refused, Refused)
    assert refused.refusal == Refusal.NO_SENSOR


@pytest.mark.parametrize(
    ("switch", "reason"),
    [
        ("tendon_cut", Reason.SNAP),
        ("cell_open", Reason.CELL),
        ("cell_saturated", Reason.CELL),
        ("cell_frozen", Reason.CELL_FROZEN),
    ],
)
def test_a_fault_ends_the_motion_and_stays_until_its_cause_is_gone(board, switch, reason):
    motors = armed(board)
    motors.command(f"set 0 {switch} 1")
    channels = follow(motors, 1000, m0=12.0)
    assert channels[0].state is BoardState.SAFE
    assert channels[0].reason is reason
    assert channels[1].state is BoardState.ARMED
    drive = motors.truth(0)[4]
    assert drive == 1  # a brake
    if reason is Reason.CELL:
        refused = motors.masked(Type.CLEAR, 0)
        assert isinstance(refused, Refused)
        assert refused.refusal == Refusal.PERSISTS


def test_swapped_cells_are_a_fault(board):
    motors = armed(board)
    motors.command("set 0 cell_of 1")
    motors.command("set 1 cell_of 0")
    for deg in (6.0, 0.0) * 4:
        channels = follow(motors, 400, m0=deg)
        if channels[0].state is BoardState.SAFE:
            break
    assert channels[0].reason is Reason.CELL_OTHER


def test_slack_that_the_loop_cannot_take_up_is_a_fault(board):
    motors = board("motor")
    motors.configure({"m0": AXIS})
    motors.command(f"set 0 tendon_slack_at {40 * DEGREE}")
    motors.step(20)
    motors.arm(0)
    channels = follow(motors, 2000, m0=0.0)
    assert channels[0].reason is Reason.SLACK
    assert channels[0].position <= 21 * DEGREE


def test_too_much_tension_is_a_fault(board):
    motors = armed(board, ceiling_n=6.0)
    assert follow(motors, 1500, m0=15.0)[0].reason is Reason.OVER_TENSION


def test_without_a_host_the_floor_goes_on_and_a_reset_is_what_the_wiring_gives(board):
    motors = armed(board)
    follow(motors, 1000, m0=-20.0)
    motors.step(2000)
    motors.demand()
    report = motors.telemetry.channels[0]
    assert (report.state, report.reason) == (BoardState.SAFE, Reason.WATCHDOG)
    for tenth in range(40):  # the body gives in by 4 degrees
        motors.command(f"set 0 tendon_slack_at {(-6.0 + tenth / 10.0) * DEGREE}")
        motors.step(20)
    motors.step(500)
    motors.demand()
    assert motors.telemetry.channels[0].tension_mn >= 950
