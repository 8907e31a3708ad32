"""What a stop does in every state: it takes power away, also from what is latched, and never gives any."""

from __future__ import annotations

import pytest

from contid_drivers.due import messages
from contid_drivers.due.codes import BoardState, Reason, RestCode, Type
from contid_drivers.due.messages import Refused

pytestmark = pytest.mark.process

HELD = {"on_watchdog": "hold", "start_state": "brake"}
HOMING = {"homing": {"direction": -1}}
VALVES = {"calibration": None, "valves": {"outlet": "normally_open"}}
COAST, BRAKE, RUN = 0, 1, 2
LET_GO = [RestCode.RELAX, RestCode.VENT]


def stop(board, rest):
    board.ask(Type.STOP, messages.stop([0], rest))
    board.step(2)


def follow(board, value, ms):
    for _ in range(ms // 5):
        board.demand({0: value})
        board.step(5)


def motor_in(board, state):
    """A motor board whose channel 0 is in that state."""
    motors = board("motor")
    safe_hold = state in ("safe, held", "safe, held and bridge", "clear, held")
    options = HELD if safe_hold else HOMING if state == "homing" else {}
    motors.configure({"m0": options})
    if state == "homing":
        motors.command("set 0 low -1e9")
        motors.demand()
        motors.masked(Type.HOME, 0)
        follow(motors, 0, 50)
    elif state == "pulsing":
        motors.demand()
        motors.ask(Type.PULSE, messages.pulse(motors.crc, motors.telemetry.uptime_ms, 0, 6000, 30))
        motors.step(3)
    elif state != "ready":
        motors.arm(0)
        follow(motors, 3000, 1500)
        follow(motors, 2000, 50)
    if state.startswith("stopped"):
        stop(motors, RestCode.HOLD if state == "stopped, held" else RestCode.RELAX)
    elif state.startswith(("safe", "clear")):
        motors.step(150)
        assert motors.trip()["reason"] == "watchdog"
    if state == "safe, held and bridge":
        motors.command("set 0 bridge 1")
        motors.step(2)
        motors.command("set 0 bridge 0")
    elif state.startswith("clear"):
        motors.masked(Type.CLEAR, 0)
    motors.step(1)
    return motors


POWERED = ["armed", "homing", "pulsing", "stopped, held", "safe, held", "clear, held"]
UNPOWERED = ["ready", "stopped, relaxed", "safe", "safe, held and bridge", "clear"]


@pytest.mark.parametrize("rest", LET_GO)
@pytest.mark.parametrize("state", POWERED + UNPOWERED)
def test_no_motor_has_power_after_a_relax(board, state, rest):
    motors = motor_in(board, state)
    before = motors.demand().channels[0]
    drive = motors.truth(0)[4]
    assert (drive == RUN) == (state in POWERED)
    stop(motors, rest)
    after = motors.demand().channels[0]
    let_go = BRAKE if state == "pulsing" else COAST
    assert motors.truth(0)[4:6] == [let_go if state in POWERED else drive, 0]
    assert after.duty == 0
    if before.state is BoardState.SAFE:
        assert (after.state, after.reason) == (BoardState.SAFE, before.reason)
    motors.step(500)
    assert motors.truth(0)[4] != RUN


@pytest.mark.parametrize("state", POWERED + UNPOWERED)
def test_a_hold_gives_no_motor_power(board, state):
    motors = motor_in(board, state)
    before = motors.demand().channels[0]
    drive = motors.truth(0)[4]
    stop(motors, RestCode.HOLD)
    assert motors.truth(0)[4] == (BRAKE if state == "pulsing" else drive)
    if state in UNPOWERED or before.state is BoardState.SAFE:
        assert motors.demand().channels[0].state is before.state


def test_a_motor_let_go_in_its_safe_state_stays_so_until_it_is_armed(board):
    motors = motor_in(board, "safe, held")
    stop(motors, RestCode.RELAX)
    stop(motors, RestCode.HOLD)
    assert motors.truth(0)[4] == COAST
    refused = motors.arm(0)
    assert isinstance(refused, Refused)
    # Another configuration, whose safe state is another or the same.
    for options in (HELD | {"stall_percent": 60}, HELD | {"stall_percent": 50}):
        assert not isinstance(motors.configure({"m0": options}, plant=False), Refused)
        assert motors.truth(0)[4] != RUN
    report = motors.demand().channels[0]
    assert (report.state, report.reason) == (BoardState.SAFE, Reason.WATCHDOG)
    assert motors.masked(Type.CLEAR, 0).channels[0].state is BoardState.READY
    motors.step(100)
    assert motors.truth(0)[4] != RUN
    stood = motors.demand().channels[0].position
    assert motors.arm(0).channels[0].state is BoardState.ARMED
    follow(motors, stood, 100)
    assert motors.truth(0)[4] == RUN


def test_a_clear_moves_nothing_that_was_let_go(board):
    motors = motor_in(board, "safe, held")
    stop(motors, RestCode.RELAX)
    motors.masked(Type.CLEAR, 0)
    motors.step(5)
    assert motors.truth(0)[4] == COAST, "as before"


def test_a_motor_let_go_in_its_safe_state_can_be_parked(board):
    motors = motor_in(board, "safe, held")
    parked = messages.park(motors.crc, [0], parked=True)
    assert isinstance(motors.ask(Type.PARK, parked), Refused)
    stop(motors, RestCode.RELAX)
    assert motors.ask(Type.PARK, parked).channels[0].position == 0


def test_a_configuration_with_hold_gives_a_latched_motor_no_power(board):
    motors = motor_in(board, "safe")
    assert not isinstance(motors.configure({"m0": HELD}, plant=False), Refused)
    report = motors.demand().channels[0]
    assert (report.state, report.reason) == (BoardState.SAFE, Reason.WATCHDOG)
    assert motors.truth(0)[4:6] == [BRAKE, 0]


def test_a_configuration_without_hold_does_not_let_go_what_a_latched_motor_holds(board):
    motors = motor_in(board, "safe, held")
    assert not isinstance(motors.configure({"m0": {}}, plant=False), Refused)
    assert motors.truth(0)[4] == RUN
    stop(motors, RestCode.RELAX)
    assert motors.truth(0)[4] == COAST


def pressed_in(board, state, **options):
    """A pressure board with 1.5 bar in the chamber of channel 0, which vents slowly where it vents."""
    air = board("pressure")
    air.configure({"p0": {"vent_bar_s": 0.2, **options}})
    air.arm(0)
    follow(air, 150_000, 1500)
    if state == "stopped, held":
        stop(air, RestCode.HOLD)
    elif state == "stopped, venting":
        stop(air, RestCode.VENT)
    elif state != "armed":
        air.step(150)
        assert air.trip()["reason"] == "watchdog"
        if state == "clear":
            assert air.masked(Type.CLEAR, 0).channels[0].state is BoardState.READY
    return air


PRESSED = ["armed", "stopped, held", "stopped, venting", "safe", "clear"]


@pytest.mark.parametrize("state", PRESSED)
def test_a_relax_lets_the_pressure_go_at_once(board, state):
    air = pressed_in(board, state)
    assert air.truth(0)[2] > 100_000
    before = air.demand().channels[0]
    stop(air, RestCode.RELAX)
    after = air.demand().channels[0]
    assert (air.truth(0)[5], after.duty) == (0, 0)
    if before.state is BoardState.SAFE:
        assert (after.state, after.reason) == (BoardState.SAFE, before.reason)
    air.step(600)
    assert air.truth(0)[2] < 2000
    # What is empty gets no pressure from any stop, nor from the end of the latch.
    for rest in RestCode:
        stop(air, rest)
        assert air.truth(0)[5] == 0
    air.masked(Type.CLEAR, 0)
    air.step(50)
    assert air.truth(0)[2] < 2000


@pytest.mark.parametrize("state", PRESSED)
def test_a_vent_lets_the_pressure_go_at_its_rate(board, state):
    air = pressed_in(board, state)
    stop(air, RestCode.VENT)
    air.step(1000)
    assert 100_000 < air.truth(0)[2] < 140_000
    stop(air, RestCode.HOLD)
    air.step(8000)
    assert air.truth(0)[2] < 2000


@pytest.mark.parametrize("rest", LET_GO)
@pytest.mark.parametrize("safe", ["vent", "close"])
@pytest.mark.parametrize("state", ["armed", "stopped, held"])
def test_a_pair_of_valves_is_empty_after_a_stop(board, state, safe, rest):
    air = pressed_in(board, state, **VALVES, on_watchdog=safe)
    stop(air, rest)
    air.step(3000)
    assert air.truth(0)[2] < 5000


@pytest.mark.parametrize("safe", ["vent", "close"])
def test_no_stop_shuts_a_pair_of_valves_in_its_safe_state(board, safe):
    air = pressed_in(board, "safe", **VALVES, on_watchdog=safe)
    for rest in RestCode:
        stop(air, rest)
    air.step(3000)
    assert air.truth(0)[2] < 5000
