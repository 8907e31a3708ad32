"""An open-loop pulse on the linked core: its bounds, what refuses it, and what its trace holds."""

from __future__ import annotations

import pytest

from contid_drivers.due import messages
from contid_drivers.due.codes import (
    DUTY_FULL,
    PULSE_DUTY,
    PULSE_MS,
    TRACE_MS,
    BoardState,
    Reason,
    Refusal,
    RestCode,
    Type,
)
from contid_drivers.due.messages import PulseTrace, Refused, Telemetry

pytestmark = pytest.mark.process

RUN, BRAKE = 2, 1


def _motors(board, *channels, **options):
    motors = board("motor")
    motors.configure(dict.fromkeys(channels or ("m0",), options))
    return motors


def order(motors, duty=PULSE_DUTY, ms=PULSE_MS, channel=0, echo_ms=None):
    """Order one pulse with the uptime of a fresh telemetry."""
    now = motors.demand().uptime_ms
    echo = now if echo_ms is None else echo_ms
    return motors.ask(Type.PULSE, messages.pulse(motors.crc, echo, channel, duty, ms))


def trace_of(motors, duty=PULSE_DUTY, ms=PULSE_MS, channel=0) -> PulseTrace:
    """The trace of one pulse, after its end."""
    answer = order(motors, duty, ms, channel)
    assert isinstance(answer, Telemetry), answer
    motors.step(TRACE_MS + 1)
    trace = motors.ask(Type.TRACE, messages.trace(motors.crc))
    assert isinstance(trace, PulseTrace)
    assert trace.complete
    return trace


def refusal(answer) -> Refusal:
    assert isinstance(answer, Refused), answer
    return Refusal(answer.refusal)


@pytest.mark.parametrize("ms", [1, 7, PULSE_MS])
def test_the_drive_ends_on_the_chip_after_exactly_its_time(board, ms):
    motors = _motors(board)
    order(motors, ms=ms)
    driven = []
    for _ in range(TRACE_MS + 10):  # the host is silent from here on
        motors.step()
        drive, duty = motors.truth(0)[4:6]
        driven.append((drive, duty))
    assert driven[:ms] == [(RUN, PULSE_DUTY)] * ms
    assert set(driven[ms:]) == {(BRAKE, 0)}


def test_the_trace_is_the_motion_of_the_shaft(board):
    motors = _motors(board, friction_percent=5, time_constant_ms=40)
    started = motors.truth(0)[0]
    order(motors)
    shaft = []
    for _ in range(TRACE_MS + 1):
        motors.step()
        shaft.append(motors.truth(0)[0] - started)
    trace = motors.ask(Type.TRACE, messages.trace(motors.crc))
    # The k-th sample is read by the tick after k ms of motion.
    assert list(trace.positions) == [int(count) for count in shaft[:TRACE_MS]]
    assert trace.positions[-1] > 5
    assert (trace.ordered_ms, trace.driven_ms, trace.duty) == (PULSE_MS, PULSE_MS, PULSE_DUTY)
    moved = trace.encoders[0]
    assert moved.counts == trace.positions[-1] == moved.edges_a + moved.edges_b
    assert abs(moved.edges_a - moved.edges_b) <= 1
    assert all(each == (0, 0, 0, 0) for each in trace.encoders[1:])
    assert motors.demand().channels[0].state is BoardState.READY


def test_the_sense_is_that_of_the_configuration(board):
    assert trace_of(_motors(board)).positions[-1] > 0
    for which in ("motor", "encoder"):
        motors = _motors(board, **{f"{which}_reversed": True})
        assert trace_of(motors).positions[-1] > 0, "wired as the configuration has it"
        motors.step(TRACE_MS + 200)
        motors.command(f"set 0 {which}_wired 0")
        assert trace_of(motors).positions[-1] < 0


@pytest.mark.parametrize(
    ("duty", "ms"),
    [(PULSE_DUTY + 1, 1), (-PULSE_DUTY - 1, 1), (DUTY_FULL, 30), (100, 0), (100, PULSE_MS + 1), (-32768, 1)],
)
def test_more_than_the_bounds_is_refused_and_moves_nothing(board, duty, ms):
    motors = _motors(board)
    assert refusal(order(motors, duty, ms)) is Refusal.BAD_VALUE
    motors.step(50)
    assert motors.truth(0)[1] == 0.0
    assert motors.demand().channels[0].state is BoardState.READY


def test_an_order_that_waited_or_comes_twice_moves_nothing(board):
    motors = _motors(board)
    old = motors.demand().uptime_ms
    motors.step(100)  # the watchdog's time
    assert refusal(order(motors, echo_ms=old)) is Refusal.STALE
    now = motors.demand().uptime_ms
    assert isinstance(order(motors, echo_ms=now), Telemetry)
    motors.step(TRACE_MS + 1)
    assert refusal(order(motors, echo_ms=now)) is Refusal.STALE
    assert isinstance(order(motors), Telemetry)


def test_nothing_pulses_beside_a_motor_under_power_and_nothing_is_armed_during_a_trace(board):
    motors = _motors(board, "m0", "m1")
    motors.arm(1)
    assert refusal(order(motors)) is Refusal.ARMED_NOW
    motors.ask(Type.STOP, messages.stop([1], RestCode.HOLD))
    assert refusal(order(motors)) is Refusal.ARMED_NOW
    motors.ask(Type.STOP, messages.stop([1], RestCode.RELAX))
    assert isinstance(order(motors), Telemetry)
    for kind in (Type.ARM, Type.HOME):
        assert isinstance(motors.masked(kind, 0), Refused)
    assert refusal(motors.masked(Type.ARM, 1)) is Refusal.ARMED_NOW
    assert refusal(order(motors, channel=1)) is Refusal.ARMED_NOW
    assert refusal(motors.ask(Type.PARK, messages.park(motors.crc, [0], True))) is Refusal.ARMED_NOW
    motors.step(TRACE_MS + 1)
    assert isinstance(motors.masked(Type.ARM, 1), Telemetry)


def test_stop_ends_a_pulse_without_power_even_when_it_asks_for_hold(board):
    motors = _motors(board)
    order(motors)
    motors.step(5)
    assert motors.demand().channels[0].state is BoardState.PULSING
    motors.ask(Type.STOP, messages.stop([0], RestCode.HOLD))
    motors.step()
    assert motors.truth(0)[4:6] == [BRAKE, 0]
    motors.step(TRACE_MS)
    trace = motors.ask(Type.TRACE, messages.trace(motors.crc))
    assert trace.driven_ms == 5


def test_a_fault_of_the_bridge_refuses_a_pulse_and_ends_one(board):
    motors = _motors(board)
    motors.command("set 0 bridge 1")
    motors.step(2)
    assert refusal(order(motors)) is Refusal.PERSISTS
    motors.command("set 0 bridge 0")
    motors.step(2)
    order(motors)
    motors.step(4)
    motors.command("set 0 bridge 1")
    motors.step(2)
    report = motors.demand().channels[0]
    assert (report.state, report.reason) == (BoardState.SAFE, Reason.BRIDGE)
    assert motors.truth(0)[4:6] == [BRAKE, 0]
    motors.step(TRACE_MS)
    trace = motors.ask(Type.TRACE, messages.trace(motors.crc))
    assert trace.driven_ms < PULSE_MS
    assert trace.faults == tuple(range(trace.faults[0], TRACE_MS))


@pytest.mark.parametrize(("track", "dead"), [("encoder_track_a", "edges_a"), ("encoder_track_b", "edges_b")])
def test_a_dead_track_has_no_edges(board, track, dead):
    motors = _motors(board)
    motors.command(f"set 0 {track} 1")
    moved = trace_of(motors).encoders[0]
    assert getattr(moved, dead) == 0
    assert moved.edges_a + moved.edges_b > 3
    assert abs(moved.counts) <= 1


def test_swapped_cables_show_on_the_other_channel(board):
    motors = _motors(board, "m0", "m1")
    motors.command("set 0 encoder_of 1")
    motors.command("set 1 encoder_of 0")
    trace = trace_of(motors)
    assert trace.encoders[0].counts == 0
    assert trace.encoders[1].counts > 5


def test_currents_rise_to_the_stall_of_a_stuck_shaft(board):
    motors = _motors(board, stall_current_ma=1000, current_ma_per_v=1000)
    motors.command("set 0 stall 1")
    trace = trace_of(motors)
    expected = 0.2 * 1500  # the plant's stall current is 1.5 times the file's threshold
    assert trace.currents_ma[1:14] == pytest.approx([expected] * 13, rel=0.02)
    assert set(trace.currents_ma[17:]) == {0}
    assert set(trace.positions) == {0}


def test_before_the_first_pulse_the_trace_is_empty(board):
    motors = _motors(board)
    assert motors.ask(Type.TRACE, messages.trace(motors.crc)) == PulseTrace(channel=None)
    assert refusal(motors.ask(Type.TRACE, messages.trace(motors.crc ^ 1))) is Refusal.WRONG_CRC
    assert refusal(order(motors, channel=1)) is Refusal.BAD_CHANNEL


def test_a_pressure_board_pulses_nothing(board):
    air = board("pressure")
    air.configure({"p0": {}})
    assert refusal(order(air)) is Refusal.WRONG_ROLE
