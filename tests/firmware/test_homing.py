"""Homing on the board: the end stop found, and every way to leave it early."""

from __future__ import annotations

import os
import random

import pytest

from contid_drivers.due import messages
from contid_drivers.due.codes import BoardState, RestCode, Type
from contid_drivers.due.messages import Refused, Telemetry

pytestmark = pytest.mark.process

HOMING = {"direction": 1, "speed_deg_s": 90, "duty_percent": 40, "at_deg": 720.0}
#: Shorter than the standstill that ends a search.
WATCHDOG_MS = 20
STOP = 500


def run(board, ms, every=5):
    """Demands without channels: they feed the watchdog and command nothing."""
    for _ in range(ms // every):
        board.demand()
        board.step(every)


def pushing(board, **options):
    """A motor that homes and has pushed its end stop for a moment, short of the standstill that ends it."""
    motors = board("motor")
    motors.configure({"m0": {"homing": HOMING, **options}}, watchdog_ms=WATCHDOG_MS)
    motors.command(f"set 0 high {STOP}")
    motors.command("set 0 low -1e9")
    motors.demand()
    motors.masked(Type.HOME, 0)
    while motors.truth(0)[0] < STOP:
        run(motors, 5)
    run(motors, 20)
    assert motors.demand().channels[0].state is BoardState.HOMING
    return motors


@pytest.mark.parametrize("end", ["hold", "watchdog"])
def test_a_homing_that_ends_in_hold_leaves_the_stop_alone(board, end):
    motors = pushing(board, on_watchdog="hold", start_state="brake")
    if end == "hold":
        motors.ask(Type.STOP, messages.stop([0], RestCode.HOLD))
        motors.step(400)
    else:
        motors.step(400)
        assert motors.trip()["reason"] == "watchdog"
    _, _, _, _, drive, duty, _ = motors.truth(0)
    assert drive == 2
    assert abs(duty) < 0.1 * 32767
    # The watches are on again: a shaft that is pushed away and blocked is found.
    motors.command(f"set 0 high {STOP - 400}")
    motors.step(600)
    assert motors.trip()["reason"] in ("watchdog", "stalled", "following")
    assert motors.truth(0)[4] == 1
    assert motors.journal("state")[-1]["reason"] in ("stalled", "following")


@pytest.mark.parametrize("rest", [RestCode.HOLD, RestCode.RELAX])
def test_an_aborted_homing_is_no_reference_and_can_be_repeated(board, rest):
    motors = pushing(board)
    motors.ask(Type.STOP, messages.stop([0], rest))
    motors.step(50)
    assert isinstance(motors.arm(0), Refused)
    motors.masked(Type.HOME, 0)
    run(motors, 3000)
    report = motors.demand().channels[0]
    assert (report.state, report.homed) == (BoardState.STOPPED, True)
    # At the speed of the axis, not of its search.
    motors.arm(0)
    for _ in range(80):
        motors.demand({0: 2000})
        motors.step(5)
    assert abs(motors.truth(0)[1]) > 3 * 90 / 360 * 4776
    assert isinstance(motors.arm(0), Telemetry)


def test_a_bridge_fault_ends_the_search(board):
    motors = pushing(board, on_watchdog="hold", start_state="brake")
    motors.command("set 0 bridge 1")
    motors.step(2)
    assert motors.trip()["reason"] == "bridge"
    assert motors.truth(0)[4] == 1
    motors.command("set 0 bridge 0")
    motors.step(1)
    assert motors.masked(Type.CLEAR, 0).channels[0].state is BoardState.READY
    assert isinstance(motors.arm(0), Refused)


def test_homing_finds_the_end_stop(board):
    motors = board("motor")
    homing = {"direction": -1, "speed_deg_s": 90, "at_deg": 30.0, "backoff_deg": 10.0}
    motors.configure({"m0": {"homing": homing}})
    motors.command("set 0 low -2000")
    assert isinstance(motors.arm(0), Refused)
    motors.masked(Type.HOME, 0)
    run(motors, 6000)
    report = motors.demand().channels[0]
    assert (report.state, report.homed) == (BoardState.STOPPED, True)
    # 30 degrees at the stop (-2000 on the plant), then 10 degrees back.
    assert report.position == pytest.approx(40.0 / 360.0 * 4776, abs=6)
    assert motors.truth(0)[0] == pytest.approx(-2000 + 10.0 / 360.0 * 4776, abs=12)
    assert isinstance(motors.arm(0), Telemetry)


def test_homing_without_end_stop_gives_up(board):
    motors = board("motor")
    motors.configure({"m0": {"homing": {"direction": 1, "timeout_s": 0.5}}})
    motors.command("set 0 high 1e9")
    motors.demand()
    motors.masked(Type.HOME, 0)
    run(motors, 700)
    assert motors.trip()["reason"] == "home_failed"


def test_homing_is_under_the_watchdog(board):
    motors = board("motor")
    motors.configure({"m0": {"homing": {"direction": 1}}})
    motors.demand()
    motors.masked(Type.HOME, 0)
    motors.step(150)
    trip = motors.trip()
    assert (trip["reason"], trip["silence_ms"]) == ("watchdog", 100)
    assert motors.truth(0)[4] == 1  # it brakes


#: One turn, and one degree, of the default gear [counts].
TURN, DEGREE = 4776, 4776 / 360.0
UP = {"direction": 1, "speed_deg_s": 90, "at_deg": 90.0, "backoff_deg": 10.0}


def homing(board, high=STOP):
    motors = board("motor")
    motors.configure({"m0": {"homing": UP}})
    motors.command(f"set 0 high {high}")
    motors.command("set 0 low -1e9")
    motors.demand()
    motors.masked(Type.HOME, 0)
    return motors


def state(motors):
    report = motors.demand().channels[0]
    return report.state, report.homed


def test_an_obstacle_that_goes_away_is_no_stop(board):
    motors = homing(board, high=200)
    while motors.truth(0)[0] < 199 or motors.truth(0)[1] > 0:
        run(motors, 5)
    run(motors, 100)  # backing off
    motors.command(f"set 0 high {STOP}")
    run(motors, 3000)
    assert motors.trip()["reason"] == "home_twice"
    motors.masked(Type.CLEAR, 0)
    assert isinstance(motors.arm(0), Refused)


def test_a_stop_that_moved_is_refused_until_the_former_one_is_given_up(board):
    motors = homing(board)
    run(motors, 4000)
    assert state(motors) == (BoardState.STOPPED, True)
    motors.ask(Type.STOP, messages.stop([0], RestCode.RELAX))
    motors.command(f"set 0 high {STOP - 2 * DEGREE}")
    for _ in range(2):
        motors.demand()
        motors.masked(Type.HOME, 0)
        run(motors, 2000)
        assert motors.journal("state")[-1]["reason"] == "home_moved"
        motors.masked(Type.CLEAR, 0)
        assert isinstance(motors.arm(0), Refused)
    motors.ask(Type.PARK, messages.park(motors.crc, [0], parked=False))
    motors.demand()
    motors.masked(Type.HOME, 0)
    run(motors, 4000)
    assert state(motors) == (BoardState.STOPPED, True)
    assert motors.demand().channels[0].position == pytest.approx(80 * DEGREE, abs=6)


@pytest.mark.parametrize("fault", ["stall", "encoder_stuck"])
def test_what_does_not_move_back_is_no_stop(board, fault):
    motors = homing(board)
    run(motors, 100)
    motors.command(f"set 0 {fault} 1")
    run(motors, 6000)
    assert state(motors) == (BoardState.SAFE, False)
    assert motors.trip()["reason"] in (
        "stalled",
        "encoder_silent",
        "following",
        "home_failed",
        "encoder_reversed",
    )


@pytest.mark.parametrize("seed", range(int(os.environ.get("CONTID_HOMINGS", "8"))))
def test_a_disturbed_search_gives_its_zero_or_a_fault(board, seed):
    """The count of the stop is its truth; a slip moves the stop against the encoder."""
    rng = random.Random(seed)
    kind = ("stall", "encoder_stuck", "obstacle", "slip")[seed % 4]
    motors = homing(board)
    stop, at_ms = STOP, rng.randrange(0, 2600, 5)
    lasts_ms = rng.choice((rng.randrange(20, 1500, 5), 20000))
    by = rng.choice((-1, 1)) * rng.uniform(1, 400)

    def found(ms):
        """Run; true when the search is over."""
        for _ in range(ms // 20):
            run(motors, 20)
            if state(motors)[0] is not BoardState.HOMING:
                return True
        return False

    if kind == "obstacle":
        # The first time it looks like the stop; later the former place of the stop does.
        found(9000)
        motors.ask(Type.STOP, messages.stop([0], RestCode.RELAX))
        # Moved by hand: the encoder counts along.
        motors.command(f"set 0 encoder_jump {-STOP - motors.truth(0)[0]:.6f}")
        motors.command(f"set 0 shaft {-STOP}")
        run(motors, 5)
        motors.demand()
        motors.masked(Type.HOME, 0)
    if not found(at_ms):
        if kind == "obstacle":
            motors.command(f"set 0 high {min(STOP, motors.truth(0)[0] + abs(by) % 50)}")
        elif kind == "slip":
            stop = max(STOP + by, motors.truth(0)[0])
            motors.command(f"set 0 high {stop}")
        else:
            motors.command(f"set 0 {kind} 1")
        if not found(lasts_ms):
            if kind == "obstacle":
                motors.command(f"set 0 high {STOP}")
            elif kind != "slip":
                motors.command(f"set 0 {kind} 0")
            found(9000)
    ended, homed = state(motors)
    assert ended is not BoardState.HOMING
    if homed:
        offset = motors.demand().channels[0].position - motors.truth(0)[0]
        late = kind == "slip" and abs(STOP + offset - 90 * DEGREE) < DEGREE + 4
        assert abs(stop + offset - 90 * DEGREE) < DEGREE + 4 or late
    else:
        assert ended is BoardState.SAFE
