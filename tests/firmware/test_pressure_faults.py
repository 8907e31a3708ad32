"""Faults of pressure channels beyond the leak: too high, not falling, a wire that is off, the trim."""

from __future__ import annotations

import math
import random

import pytest

from contid.hal import AxisOnBus
from contid_drivers.due import frames, messages, wiring
from contid_drivers.due.codes import BoardState, Reason, Refusal, RestCode, Type
from contid_drivers.due.messages import Refused, Telemetry
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role, SafeState
from tests.firmware.conftest import REGULATOR

pytestmark = pytest.mark.process

#: A 0-10 V read-back behind a divider: no live zero, so a wire that is off reads 0 bar.
NO_LIVE_ZERO = {"readback": [[0, 0], [3000, 3]], "wire_break_mv": 0}


def demand(board, pascal, ms, every=5):
    for _ in range(ms // every):
        board.demand({0: pascal})
        board.step(every)


def pressed(board, pascal, **options):
    air = board("pressure")
    air.configure({"p0": options})
    air.arm(0)
    demand(air, pascal, 1500)
    assert air.truth(0)[2] == pytest.approx(pascal, abs=1500)
    return air


def test_a_pressure_that_stays_above_its_set_point_is_a_fault(board):
    air = pressed(board, 50_000, over_bar=0.2, over_ms=400)
    air.command("set 0 full_pa 600000")  # the regulator's gain doubles: 1 bar instead of 0.5
    began = air.telemetry.uptime_ms
    demand(air, 50_000, 900)
    trip = air.trip()
    assert trip["reason"] == "above_set_point"
    assert trip["world_ms"] - began <= 400 + 150
    air.step(1500)
    assert air.truth(0)[2] < 2000


def test_a_chamber_that_empties_slowly_is_no_fault(board):
    air = pressed(board, 150_000, over_bar=0.2, over_ms=300, slew_bar_s=20)
    air.command("set 0 lag 1.5")
    demand(air, 0, 4000)
    assert air.telemetry.channels[0].state is BoardState.ARMED


@pytest.mark.parametrize("pascal", [15_000, 12_000])
def test_a_wire_that_is_off_below_the_leak_band(board, pascal):
    air = pressed(board, pascal, **NO_LIVE_ZERO, leak_bar=0.2, leak_ms=300, trim_bar=0.3)
    air.command("set 0 wire 1")
    began = air.telemetry.uptime_ms
    highest = 0.0
    for _ in range(200):
        demand(air, pascal, 5)
        highest = max(highest, air.truth(0)[2])
    assert air.trip()["reason"] == "leak"
    assert air.trip()["world_ms"] - began <= 350
    assert highest < pascal + 2000  # the trim does not follow a reading outside the band


def test_a_wire_that_is_off_at_the_lowest_pressures_adds_at_most_half(board):
    air = pressed(board, 4_000, **NO_LIVE_ZERO, trim_bar=0.3)
    air.command("set 0 wire 1")
    demand(air, 4_000, 5000)
    assert air.truth(0)[2] <= 6_100


def test_the_trim_still_corrects_inside_the_band(board):
    air = pressed(board, 100_000, trim_bar=0.3)
    air.command("set 0 full_pa 285000")
    demand(air, 100_000, 6000)
    assert air.truth(0)[2] == pytest.approx(100_000, abs=500)


def test_a_reading_below_zero_is_a_wire_that_is_off(board):
    # Live zero at 600 mV without wire_break_mv: off reads -0.75 bar.
    air = board("pressure")
    air.configure({"p0": {"wire_break_mv": 0}})
    air.command("set 0 wire 1")
    air.step(50)
    refused = air.arm(0)
    assert isinstance(refused, Refused)
    assert refused.refusal == Refusal.NO_SENSOR


@pytest.mark.parametrize("wait", [30, 1600])
def test_over_the_ceiling_while_ready(board, wait):
    air = board("pressure")
    air.configure({"p0": {}})
    air.command("set 0 lag 1e9")  # what is in the chamber stays in it
    air.command("set 0 pressure 250000")
    air.step(wait)
    report = air.demand().channels[0]
    assert (report.state, report.reason) == (BoardState.SAFE, Reason.OVER_PRESSURE)
    cleared = air.masked(Type.CLEAR, 0)
    assert isinstance(cleared, Refused)
    assert cleared.refusal == Refusal.PERSISTS
    air.command("set 0 pressure 0")
    air.step(20)
    assert isinstance(air.masked(Type.CLEAR, 0), Telemetry)
    assert isinstance(air.arm(0), Telemetry)


def test_a_vent_that_does_not_fall(board):
    air = pressed(board, 100_000, over_bar=0.2, over_ms=400)
    air.command("set 0 lag 1e9")
    air.step(2500)  # the watchdog vents
    reasons = [e["reason"] for e in air.journal("state") if e["state"] == "safe"]
    assert reasons == ["watchdog", "not_venting"]
    assert isinstance(air.masked(Type.CLEAR, 0), Refused)
    air.command("set 0 lag 0.03")
    air.step(500)
    assert isinstance(air.masked(Type.CLEAR, 0), Telemetry)


def test_hold_is_no_safe_state_of_a_chamber(board):
    axis = AxisOnBus("p0", DueAxisOptions.model_validate({"channel": "p0", **REGULATOR}))
    blob = bytearray(wiring.board_config("b", DueBusOptions(port="x", role=Role.PRESSURE), [axis]))
    air = board("pressure")
    for start in SafeState:
        blob[5:7] = bytes([SafeState.HOLD.code, start.code])
        refused = air.ask(Type.CONFIGURE, frames.crc16(bytes(blob)).to_bytes(2, "little") + bytes(blob))
        assert isinstance(refused, Refused)
        assert refused.refusal in (Refusal.BAD_VALUE, Refusal.SAFE_IS_NOT_START)


def swing(board, ms, bar=0.3, period_ms=1000, every=5):
    """Demands of 1 bar and a wave on it."""
    for _ in range(ms // every):
        wave = bar * math.sin(2 * math.pi * board.telemetry.uptime_ms / period_ms)
        board.demand({0: round((1.0 + wave) * 1e5)})
        board.step(every)


@pytest.mark.parametrize("period_ms", [500, 1000, 2000, 4000])
def test_a_frozen_reading_under_a_moving_demand_is_a_fault(board, period_ms):
    air = pressed(board, 100_000)
    swing(air, 2000, period_ms=period_ms)
    demand(air, 100_000, 1000)
    air.command("set 0 read_back_frozen 1")
    began = air.telemetry.uptime_ms
    swing(air, 3000, period_ms=period_ms)
    assert air.trip()["reason"] == "read_back"
    assert air.trip()["world_ms"] - began <= max(period_ms, 500) + 350
    air.step(1500)
    assert air.truth(0)[2] < 2000  # it vented
    air.command("set 0 read_back_frozen 0")
    air.step(50)
    assert isinstance(air.masked(Type.CLEAR, 0), Telemetry)


def test_a_frozen_reading_at_rest_is_none(board):
    air = pressed(board, 100_000)
    air.command("set 0 read_back_frozen 1")
    demand(air, 100_000, 3000)
    assert air.telemetry.channels[0].state is BoardState.ARMED


@pytest.mark.parametrize(
    "lag", [0.005, *(pytest.param(lag, marks=pytest.mark.campaign) for lag in (0.03, 0.15, 0.3)), 1.1]
)
@pytest.mark.parametrize("slew_bar_s", [0.5, pytest.param(2.0, marks=pytest.mark.campaign), 20.0])
def test_a_reading_that_lags_is_no_fault(board, lag, slew_bar_s):
    """Volumes from a drop to a large arm, with lags up to three times their file's."""
    air = board("pressure")
    lag_ms = max(150, round(lag * 1000 / 3))
    air.configure({"p0": {"slew_bar_s": slew_bar_s, "leak_ms": 5000, "over_ms": 5000, "lag_ms": lag_ms}})
    air.command(f"set 0 lag {lag}")
    air.arm(0)
    rng = random.Random(f"{lag} {slew_bar_s}")
    for _ in range(25):
        if rng.random() < 0.5:
            demand(air, round(rng.uniform(0.0, 1.5) * 1e5), rng.randrange(50, 1500, 50))
        else:
            swing(air, rng.randrange(200, 2000, 50), rng.uniform(0.05, 0.5), rng.choice((300, 1000, 3000)))
        assert air.telemetry.channels[0].state is BoardState.ARMED, air.telemetry.channels[0].reason


def test_a_channel_that_was_left_out_for_a_while_gets_no_pressure_when_it_returns(board):
    air = pressed(board, 100_000)
    air.ask(Type.STOP, messages.stop([0], RestCode.HOLD))
    air.configure({"p1": {}})
    air.step(1500)
    assert air.truth(0)[2] < 2000
    air.configure({"p0": {}, "p1": {}})
    highest = 0.0
    for _ in range(40):
        air.step(5)
        highest = max(highest, air.truth(0)[2])
    assert highest < 2000


VALVES = {"calibration": None, "valves": {"outlet": "normally_open"}}


@pytest.mark.parametrize("options", [{}, VALVES])
def test_a_value_out_of_range_of_a_regulator_is_named_as_one(board, options):
    keys = {"channel": "p0", **REGULATOR, **options}
    axis = AxisOnBus("p0", DueAxisOptions.model_validate(keys))
    blob = bytearray(wiring.board_config("b", DueBusOptions(port="x", role=Role.PRESSURE), [axis]))
    air = board("pressure")
    blob[7:11] = bytes(4)  # the ceiling
    refused = air.ask(Type.CONFIGURE, wiring.config_body(bytes(blob)))
    assert isinstance(refused, Refused)
    assert (refused.refusal, refused.detail) == (Refusal.BAD_VALUE, 3 + 2 + 11)
    whole = wiring.board_config("b", DueBusOptions(port="x", role=Role.PRESSURE), [axis])
    short = air.ask(Type.CONFIGURE, wiring.config_body(whole[:-1]))
    assert isinstance(short, Refused)
    assert short.refusal == Refusal.WRONG_LENGTH
