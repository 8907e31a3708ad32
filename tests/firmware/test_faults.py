"""Every fault switch: which state, why, and when; in virtual time, so every figure is exact to the tick."""

from typing import Any

import pytest

from contid_drivers.due import messages
from contid_drivers.due.codes import BoardState, Reason, Refusal, ResetCause, RestCode, Type
from contid_drivers.due.messages import Refused, Telemetry

pytestmark = pytest.mark.process

MOVING = 6081  # counts/s at 10 cm/s


def _run(board, values, ms, every=5):
    for _ in range(ms // every):
        board.demand(values(board.telemetry.uptime_ms))
        board.step(every)


def _moving_motor(board, **options):
    motors = board("motor")
    motors.configure({"m0": options})
    motors.arm(0)
    start = motors.telemetry.uptime_ms
    ramp = lambda now: {0: round((now - start) * MOVING / 1000)}  # noqa: E731 - one line is what it is
    _run(motors, ramp, 600)
    assert motors.truth(0)[1] == pytest.approx(MOVING, rel=0.05)
    return motors, ramp


def _pressed(board, **options):
    air = board("pressure")
    air.configure({"p0": options})
    air.arm(0)
    _run(air, lambda now: {0: 150_000}, 1500)
    assert air.truth(0)[2] == pytest.approx(150_000, abs=1500)
    return air


@pytest.mark.parametrize("safe", ["brake", "coast", "hold"])
def test_watchdog_stops_a_motor_at_10_cm_s(board, safe):
    motors, _ = _moving_motor(board, on_watchdog=safe, start_state="coast" if safe == "coast" else "brake")
    motors.step(400 if safe != "coast" else 1500)
    trip = motors.trip()
    assert (trip["reason"], trip["silence_ms"]) == ("watchdog", 100)
    rest = next(e for e in motors.journal("rest") if e["world_ms"] >= trip["world_ms"])
    assert rest["world_ms"] - trip["world_ms"] <= {"brake": 150, "coast": 1000, "hold": 400}[safe]
    drive = motors.truth(0)[4]
    assert drive == {"brake": 1, "coast": 0, "hold": 2}[safe]


@pytest.mark.parametrize(("safe", "longest_ms"), [("vent", 1000), ("close", 400)])
def test_watchdog_vents_1_5_bar(board, safe, longest_ms):
    air = _pressed(board, on_watchdog=safe, vent_bar_s=2.0)
    air.step(1500)
    trip = air.trip()
    assert (trip["reason"], trip["silence_ms"]) == ("watchdog", 100)
    vented = next(e for e in air.journal("rest") if e["world_ms"] > trip["world_ms"])
    assert vented["world_ms"] - trip["world_ms"] <= longest_ms
    assert air.truth(0)[4:6] == [0, 0]


def test_latched_until_cleared_then_armed_where_it_stands(board):
    motors, _ = _moving_motor(board)
    motors.step(300)
    stood = motors.demand({0: 60_000}).channels[0]
    assert (stood.state, stood.reason) == (BoardState.SAFE, Reason.WATCHDOG)
    refused = motors.masked(Type.ARM, 0)
    assert isinstance(refused, Refused)
    assert motors.masked(Type.CLEAR, 0).channels[0].state is BoardState.READY
    assert motors.masked(Type.ARM, 0).channels[0].state is BoardState.ARMED
    motors.step(50)
    assert abs(motors.demand().channels[0].position - stood.position) <= 1


def test_a_host_that_receives_nothing_does_not_feed_the_watchdog(board):
    motors, ramp = _moving_motor(board)
    deaf_since = motors.telemetry.uptime_ms
    for _ in range(60):  # demands keep coming, but always name the same old telemetry
        motors.demand(ramp(deaf_since), echo_ms=deaf_since)
        motors.step(5)
    trip = motors.trip()
    # The last demand that counts is the first with the last telemetry.
    assert trip["reason"] == "watchdog"
    assert trip["world_ms"] - deaf_since <= 100 + 5 + 1  # a demand every 5 ms
    assert motors.demand(echo_ms=deaf_since).stale


@pytest.mark.parametrize("left_ms", [50, 300, 1000])
def test_the_wrap_of_the_clock_after_49_days_has_no_effect(board, left_ms):
    motors = board("motor")
    motors.command(f"old {2**32 - left_ms}")
    motors.step(40)  # it starts
    motors.configure({"m0": {}})
    motors.arm(0)
    goal = 0
    for _ in range(200):
        goal += MOVING // 200
        telemetry = motors.demand({0: goal})
        assert (telemetry.channels[0].state, telemetry.stale) == (BoardState.ARMED, False)
        motors.step(5)
    assert motors.telemetry.uptime_ms < 2000
    assert motors.truth(0)[1] == pytest.approx(MOVING, rel=0.05)
    motors.step(400)
    assert (motors.trip()["reason"], motors.trip()["silence_ms"]) == ("watchdog", 100)


def test_the_watchdog_trips_across_the_wrap_and_old_demands_stay_old(board):
    motors = board("motor")
    motors.command(f"old {2**32 - 250}")
    motors.step(40)
    motors.configure({"m0": {}})
    motors.arm(0)
    newest_ms = motors.demand({0: 100}).uptime_ms
    while (newest_ms + 30) % 2**32 > newest_ms:  # the last demand comes shortly before the wrap
        motors.step(5)
        newest_ms = motors.demand({0: 100}).uptime_ms
    motors.step(150)
    assert (motors.trip()["reason"], motors.trip()["silence_ms"]) == ("watchdog", 100)
    assert motors.demand({0: 200}, echo_ms=newest_ms).stale
    assert not motors.demand({0: 200}).stale


def test_stalled_motor(board):
    motors, ramp = _moving_motor(board, stall_ms=100)
    motors.command("set 0 stall 1")
    began = motors.telemetry.uptime_ms
    _run(motors, ramp, 300)
    trip = motors.trip()
    assert trip["reason"] == "stalled"
    assert trip["world_ms"] - began <= 130


@pytest.mark.parametrize(("switch", "reason"), [("encoder_stuck", "encoder_silent"), ("stall", "stalled")])
def test_current_distinguishes_a_dead_encoder_from_a_stall(board, switch, reason):
    motors, ramp = _moving_motor(board, stall_ms=100, stall_current_ma=1000)
    motors.command(f"set 0 {switch} 1")
    began = motors.telemetry.uptime_ms
    _run(motors, ramp, 300)
    assert motors.trip()["reason"] == reason
    assert motors.trip()["world_ms"] - began <= 130


def test_reversed_encoder_while_moving(board):
    motors, ramp = _moving_motor(board)
    motors.command("set 0 encoder_reversed 1")
    began = motors.telemetry.uptime_ms
    _run(motors, ramp, 300)
    assert motors.trip()["reason"] == "encoder_reversed"
    assert motors.trip()["world_ms"] - began <= 100


def test_reversed_encoder_at_the_first_motion(board):
    motors = board("motor")
    motors.configure({"m0": {}})
    motors.command("set 0 encoder_reversed 1")
    motors.arm(0)
    began = motors.telemetry.uptime_ms
    _run(motors, lambda now: {0: 6000}, 400)
    assert motors.trip()["reason"] == "encoder_reversed"
    assert motors.trip()["world_ms"] - began <= 250
    assert abs(motors.truth(0)[0]) < 20 * 60.8  # it ran away by less than 20 mm


@pytest.mark.parametrize(("encoder", "motor"), [(True, False), (False, True), (True, True)])
def test_motor_or_encoder_turned_around_by_configuration(board, encoder, motor):
    """The emulated wiring is that of the robot file: the true shaft goes where it is sent."""
    motors = board("motor")
    motors.configure({"m0": {"encoder_reversed": encoder, "motor_reversed": motor}})
    motors.arm(0)
    _run(motors, lambda now: {0: 3000}, 1500)
    assert motors.demand().channels[0].position == pytest.approx(3000, abs=5)
    assert motors.truth(0)[0] == pytest.approx(3000, abs=6)
    motors.command("set 0 encoder_reversed 1")
    _run(motors, lambda now: {0: 0}, 400)
    assert motors.trip()["reason"] == "encoder_reversed"


@pytest.mark.parametrize("kept", ["stopped", "watchdog"])
def test_a_motor_that_holds_is_neither_lost_nor_let_go(board, kept):
    """Without power from the host: stopped to hold, or held by its watchdog."""
    motors = board("motor")
    motors.configure({"m0": (held := {"on_watchdog": "hold", "start_state": "brake"})})
    motors.arm(0)
    _run(motors, lambda now: {0: 3000}, 1500)
    if kept == "stopped":
        motors.ask(Type.STOP, messages.stop([0], RestCode.HOLD))
    else:
        motors.step(150)
        assert motors.trip()["reason"] == "watchdog"
    others: tuple[dict[str, Any], ...] = (
        {"m1": {}},
        {"m0": held | {"encoder_reversed": True}},
        {"m0": held | {"motor_reversed": True}},
        {"m0": held | {"power_up_deg": 10.0}},
        {"m0": held | {"bridge": "tb6612"}},
    )
    for other in others:
        refused = motors.configure(other, plant=False)
        assert isinstance(refused, Refused)
        assert refused.refusal == Refusal.ARMED_NOW
    refused = motors.ask(Type.PARK, messages.park(motors.crc, [0], parked=True))
    assert isinstance(refused, Refused)
    assert refused.refusal == Refusal.ARMED_NOW
    assert not isinstance(motors.configure({"m0": held | {"stall_percent": 60}}, plant=False), Refused)
    report = motors.demand().channels[0]
    assert report.state is (BoardState.STOPPED if kept == "stopped" else BoardState.SAFE)
    assert not report.position_lost
    assert report.position == pytest.approx(3000, abs=5)
    assert motors.truth(0)[4] == 2, "it runs"


def test_leak(board):
    air = _pressed(board, leak_ms=300)
    air.command("set 0 leak 1")
    began = air.telemetry.uptime_ms
    _run(air, lambda now: {0: 150_000}, 800)
    trip = air.trip()
    assert trip["reason"] == "leak"
    assert trip["world_ms"] - began <= 400
    air.step(1000)
    assert air.truth(0)[5] == 0  # it does not feed the leak


def test_broken_sensor_wire(board):
    air = _pressed(board)
    air.command("set 0 wire 1")
    began = air.telemetry.uptime_ms
    _run(air, lambda now: {0: 150_000}, 100)
    trip = air.trip()
    assert trip["reason"] == "sensor_wire"
    assert trip["world_ms"] - began <= 30
    assert not air.telemetry.channels[0].sensor_ok
    assert isinstance(air.masked(Type.CLEAR, 0), Refused)  # it persists
    air.command("set 0 wire 0")
    air.step(10)  # the reading is the mean of 8
    assert isinstance(air.masked(Type.CLEAR, 0), Telemetry)


def test_broken_wire_of_a_0_to_10_v_signal_shows_as_a_leak(board):
    air = _pressed(board, readback=[[0, 0], [3125, 3]], wire_break_mv=0)
    air.command("set 0 wire 1")
    _run(air, lambda now: {0: 150_000}, 800)
    assert air.trip()["reason"] == "leak"


def test_over_pressure_vents(board):
    air = _pressed(board)
    air.command("set 0 full_pa 600000")  # the regulator's gain doubles
    began = air.telemetry.uptime_ms
    _run(air, lambda now: {0: 150_000}, 300)
    trip = air.trip()
    assert trip["reason"] == "over_pressure"
    assert trip["world_ms"] - began <= 100
    air.step(1500)
    assert air.truth(0)[2] < 2000


@pytest.mark.parametrize(("command", "cause"), [("reset", "PIN"), ("brown_out", "BROWN_OUT")])
def test_reset_leaves_outputs_off_and_is_reported(board, command, cause):
    motors, _ = _moving_motor(board)
    motors.command(command)
    motors.step(1)
    assert motors.truth(0)[4:6] == [3, 0]  # not driven
    motors.step(30)
    hello = motors.ask(Type.HELLO)
    assert (hello.cause, hello.boot, hello.configured) == (ResetCause[cause], 2, False)


def test_the_hardware_watchdog_resets_a_frozen_loop_before_the_dead_man(board):
    motors, _ = _moving_motor(board)
    began = motors.journal("boot")[-1]["world_ms"] + motors.telemetry.uptime_ms
    motors.command("freeze")
    motors.step(400)
    boot = motors.journal("boot")[-1]
    assert (boot["cause"], boot["world_ms"] - began <= 5 + 50) == ("watchdog", True)
    assert motors.truth(0)[4] == 3, "off: what the wiring of a board in reset gives"


def test_a_frozen_loop_without_hardware_watchdog_trips_the_dead_man(board):
    motors, _ = _moving_motor(board)
    began = motors.telemetry.uptime_ms
    motors.command("watchdog 0")
    motors.command("freeze")
    motors.step(400)
    trip = motors.trip()
    assert trip["reason"] == "watchdog"
    assert trip["world_ms"] - began <= 100 + 5


def test_garbage_on_the_line_is_counted_and_answered_by_nothing(board):
    motors, ramp = _moving_motor(board)
    before = motors.telemetry.bad_frames
    for noise in (b"\xff" * 2000 + b"\0", bytes(range(1, 255)) + b"\0", b"\x05\x01\0", b"\0\0\0"):
        assert motors.wire(noise) == b""
    _run(motors, ramp, 50)
    assert motors.telemetry.bad_frames == before + 3
    assert motors.telemetry.channels[0].state is BoardState.ARMED


def test_bridge_fault(board):
    motors, ramp = _moving_motor(board)
    motors.command("set 0 bridge 1")
    began = motors.telemetry.uptime_ms
    _run(motors, ramp, 20)
    assert motors.trip()["reason"] == "bridge"
    assert motors.trip()["world_ms"] - began <= 5 + 2
    assert isinstance(motors.masked(Type.CLEAR, 0), Refused)
    motors.command("set 0 bridge 0")
    motors.step()
    assert motors.masked(Type.CLEAR, 0).channels[0].state is BoardState.READY


def test_a_channel_that_fails_reports_nothing_and_cannot_be_armed(board):
    motors = board("motor")
    motors.configure({"m0": {}, "m1": {}})
    motors.command("silent 1 1")
    assert set(motors.demand().channels) == {0}
    assert isinstance(motors.arm(0, 1), Refused)
    assert isinstance(motors.arm(0), Telemetry)


def test_frozen_loop_of_a_pressure_board(board):
    air = _pressed(board, vent_bar_s=4.0)
    began = air.telemetry.uptime_ms
    air.command("freeze")
    air.step(1500)
    boot = air.journal("boot")[-1]
    assert (boot["cause"], boot["world_ms"] - began <= 5 + 50) == ("watchdog", True)
    assert air.truth(0)[2] < 2000


def test_missed_encoder_edges_end_the_motion_and_lose_the_position(board):
    motors, ramp = _moving_motor(board)
    motors.command("set 0 missed 7")
    _run(motors, ramp, 20)
    assert motors.telemetry.channels[0].state is BoardState.ARMED
    motors.command("set 0 missed 8")
    _run(motors, ramp, 10)
    assert motors.trip()["reason"] == "encoder_edges"
    assert isinstance(motors.masked(Type.CLEAR, 0), Telemetry)
    refused = motors.masked(Type.ARM, 0)
    assert isinstance(refused, Refused)
    assert refused.refusal == Refusal.POSITION_LOST


def test_arm_and_home_without_an_echo_feed_nothing(board):
    motors = board("motor")
    motors.configure({"m0": {}, "m1": {"homing": {"direction": -1}}})
    motors.arm(0)
    began = motors.telemetry.uptime_ms
    for kind, channel in ((Type.ARM, 0), (Type.HOME, 1)) * 4:
        motors.step(30)
        motors.masked(kind, channel)
    assert motors.trip(0)["reason"] == "watchdog"
    assert motors.trip(0)["world_ms"] - began <= 110
