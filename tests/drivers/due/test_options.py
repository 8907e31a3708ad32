"""Options of a Due board: what is refused, and what reaches the board."""

from __future__ import annotations

import math
import re
import struct
from pathlib import Path

import pytest
from pydantic import ValidationError

from contid.errors import BadInputError, DeviceError
from contid.hal import AxisOnBus, DeviceKind, load_driver
from contid.robot_file.load import parse_robot_file
from contid_drivers.due.axis import BoardAxis
from contid_drivers.due.motor_options import EndStop
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from contid_drivers.due.wiring import board_config
from contid_emulate.due import BoardFault

REGULATOR = {"calibration": [[0, 0], [100, 3]], "readback": [[600, 0], [3000, 3]], "ceiling_bar": 1.6}
CELL = {"readings": [[500, 0], [1500, 10]], "floor_n": 1, "stiffness_n_per_deg": 1}
BAD = [
    ({"channel": "m0", "no_load_deg_s": 452}, "velocity_deg_s 470 exceeds no_load_deg_s 452"),
    ({"channel": "m6"}, "channel"),
    ({"channel": "m0", "on_watchdog": "vent"}, "brake, coast, hold"),
    ({"channel": "p0", **REGULATOR, "on_watchdog": "coast"}, "vent, close"),
    ({"channel": "p0", **REGULATOR, "on_watchdog": "hold"}, "vent, close"),
    ({"channel": "m0", "on_watchdog": "coast"}, "start_state brake differs"),
    ({"channel": "m0", "on_watchdog": "coast", "start_state": "brake"}, "start_state brake differs"),
    ({"channel": "m0", "start_state": "coast"}, "start_state coast differs from on_watchdog brake"),
    ({"channel": "m0", "on_watchdog": "hold"}, r"needs start_state.*brake or coast"),
    ({"channel": "m0", "on_watchdog": "hold", "start_state": "hold"}, "not possible"),
    (
        {"channel": "m0", "bridge": "dir_pwm", "on_watchdog": "coast", "start_state": "coast"},
        "with bridge dir_pwm",
    ),
    ({"channel": "m0", "bridge": "l293"}, "bridge"),
    ({"channel": "p0", **REGULATOR, "start_state": "vent"}, "sets the command to zero at once"),
    ({"channel": "p0", **REGULATOR, "bridge": "in_in"}, "it has no bridge"),
    ({"channel": "m0", "ceiling_bar": 2}, "is a motor; it has no ceiling_bar"),
    ({"channel": "p0", **REGULATOR, "stall_ms": 100}, "is a regulator; it has no stall_ms"),
    ({"channel": "m0", "current_ma_per_v": 25_000}, "less than or equal to 19800"),  # ACS758-050B: 40 mV/A
    ({"channel": "m0", "stall_current_ma": 3300}, "never read: the pin ends at 3300 mA"),
    (
        {"channel": "m0", "homing": {"direction": 1, "speed_deg_s": 600}},
        "speed_deg_s 600 exceeds no_load_deg_s 575",
    ),
    ({"channel": "m0", "tension": {**CELL, "ceiling_n": 29}}, "never read: readings end at 28 N"),
    ({"channel": "p0", **REGULATOR, "readback": [[0, 0], [3300, 1.5]]}, "readback ends at 1.5 bar"),
    ({"channel": "p0", **REGULATOR, "wire_break_mv": 600}, "must be below 600 mV"),
    ({"channel": "p0"}, "needs calibration, readback, ceiling_bar"),
    ({"channel": "p0", **REGULATOR, "ceiling_bar": 3.5}, "must reach from 0 bar to ceiling_bar 3.5"),
    ({"channel": "p0", **REGULATOR, "calibration": [[0, 0], [0, 3]]}, "must both rise"),
    ({"channel": "p0", **REGULATOR, "calibration": [[0, 0], [101, 3]]}, "0 to 100"),
    ({"channel": "p0", **REGULATOR, "readback": [[600, 3], [3000, 0]]}, "readback"),
    ({"channel": "p0", **REGULATOR, "calibration": [[i, i] for i in range(9)]}, "2 to 8 rows"),
]


def test_the_programming_port_is_refused_for_motors_without_homing(configs: Path) -> None:
    """It resets the board at every open, which loses the count of such a motor."""
    text = (configs / "trirack.emulated.yaml").read_text()
    text = text.replace("    role: motor\n", "    connection: programming\n    role: motor\n")
    with pytest.raises(BadInputError) as raised:
        parse_robot_file(text, "trirack.yaml")
    (found,) = raised.value.findings
    assert text.splitlines()[found.line - 1] == "    connection: programming"
    assert "arm.s1.l1, arm.s1.l2, arm.s1.l3 would lose the position" in found.message
    homed = re.sub(r"(channel: m\d)", r"\1, homing: {direction: -1}", text)
    assert parse_robot_file(homed, "trirack.yaml").buses
    assert parse_robot_file(text, "old.yaml", recorded=True).buses


@pytest.mark.parametrize(("options", "message"), BAD)
def test_refused(options, message):
    with pytest.raises(ValidationError, match=message):
        DueAxisOptions.model_validate(options)


def test_counts_of_a_turn_and_of_650_mm():
    axis = BoardAxis(AxisOnBus("a.x", DueAxisOptions(channel="m0")))
    assert axis.to_board(math.tau) == 4776
    assert axis.to_board(650.0 / (math.pi * 25.0) * math.tau) == 39526
    assert axis.to_board(-1e300) == -1_000_000_000


def test_the_configuration_is_in_the_boards_units():
    motor = AxisOnBus("a.x", DueAxisOptions(channel="m2", homing=EndStop(direction=-1)), (0.0, math.tau))
    blob = board_config("b", DueBusOptions(port="x", role=Role.MOTOR, watchdog_ms=80), [motor])
    assert struct.unpack_from("<BHB", blob) == (0, 80, 1)
    channel, safe, start, flags, bridge, low, high, velocity, acceleration = struct.unpack_from(
        "<5B4i", blob, 4
    )
    assert (channel, safe, start, flags, bridge) == (2, 0, 0, 4, 0)
    assert (low, high) == (0, 4776)
    assert velocity == round(470.0 / 360.0 * 4776)
    assert acceleration == round(2300.0 / 360.0 * 4776)


def test_the_configuration_of_a_regulator_is_in_pascal():
    options_given = {
        "slew_bar_s": 2.0,
        "vent_bar_s": 4.0,
        "wire_break_mv": 540,
        "leak_bar": 0.3,
        "leak_ms": 700,
    }
    options = DueAxisOptions.model_validate(
        {"channel": "p1", **REGULATOR, **options_given, "trim_bar": 0.2, "trim_per_s": 1.5}
    )
    blob = board_config("b", DueBusOptions(port="x", role=Role.PRESSURE), [AxisOnBus("a.x", options, None)])
    # firmware/PROTOCOL.md: channel, safe, start, then the regulator's numbers.
    found = struct.unpack("<3B3iHiHiHiHiHH2iB", blob[4:-12])
    assert found[0] == 1
    assert found[3:6] == (160_000, 200_000, 400_000)
    assert found[6:11] == (
        round(600 / 3300 * 4095),
        0,
        round(3000 / 3300 * 4095),
        300_000,
        round(540 / 3300 * 4095),
    )
    assert found[11:] == (30_000, 700, 20_000, 1000, 150, 20_000, round(1.5 * 256), 2)
    assert struct.unpack("<HiHi", blob[-12:]) == (0, 0, 32767, 300_000)


def test_a_motor_on_a_pressure_board_is_refused_by_name():
    motor = AxisOnBus("arm.s1.l1", DueAxisOptions(channel="m0"), None)
    with pytest.raises(DeviceError, match=r"arm\.s1\.l1.*channel m0 does not exist on a pressure board"):
        board_config("air", DueBusOptions(port="x", role=Role.PRESSURE), [motor])


def test_driver_protocol():
    driver = load_driver("due")
    motor, regulator = (
        DueAxisOptions(channel="m3"),
        DueAxisOptions.model_validate({"channel": "p1", **REGULATOR}),
    )
    assert (driver.kind(motor), driver.address(motor)) == (DeviceKind.MOTOR, "channel m3")
    assert (driver.kind(regulator), driver.address(regulator)) == (DeviceKind.REGULATOR, "channel p1")
    sim = load_driver("sim")
    for axis in (motor, regulator):
        sim.axis_options.model_validate(driver.mock_axis_options(axis))
    sim.bus_options.model_validate(driver.mock_options(DueBusOptions(port="x", role=Role.MOTOR)))


@pytest.mark.parametrize(
    ("entry", "command"),
    [
        ({"fault": "leak", "channel": 2}, "set 2 leak 1"),
        ({"fault": "wire", "channel": 2, "on": False}, "set 2 wire 0"),
        ({"fault": "silent", "channel": 1}, "silent 1 1"),
        ({"fault": "garbage"}, "garbage 1"),
        ({"fault": "freeze", "ms": 400}, "freeze 400"),
        ({"fault": "brown_out"}, "brown_out"),
    ],
)
def test_fault_switches(entry, command):
    assert BoardFault.model_validate(entry).command == command


@pytest.mark.parametrize("entry", [{"fault": "laek"}, {"fault": "leak", "channel": [1]}, {}, "leak"])
def test_wrong_fault_switches_are_refused(entry):
    with pytest.raises(ValidationError):
        BoardFault.model_validate(entry)


VALVES = {"channel": "p0", "readback": [[0, 0], [3000, 1]], "ceiling_bar": 0.8}


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"valves": {"outlet": "normally_closed"}}, "keeps the pressure in a reset: write hold"),
        ({"valves": {"outlet": "normally_open"}, "start_state": "hold"}, "start_state hold .* not possible"),
        ({"valves": {"outlet": "normally_open"}, "calibration": [[0, 0], [100, 1]]}, "it has no calibration"),
        ({}, "needs calibration"),
    ],
)
def test_a_pair_of_valves_states_what_a_reset_does(keys: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        DueAxisOptions.model_validate(VALVES | keys)
    DueAxisOptions.model_validate(VALVES | {"valves": {"outlet": "normally_closed"}, "start_state": "hold"})


def test_limits_at_the_end_of_what_a_pin_reads_are_allowed() -> None:
    """A sensor whose rows end before the pin does is read beyond them."""
    motor = {"start_state": "brake", "tension": {**CELL, "ceiling_n": 28}, "stall_current_ma": 3299}
    DueAxisOptions.model_validate({"channel": "m0", **motor})
    DueAxisOptions.model_validate({"channel": "p0", **REGULATOR, "readback": [[600, 0], [2000, 1.0]]})
    DueAxisOptions.model_validate({"channel": "p0", **REGULATOR, "wire_break_mv": 540})
