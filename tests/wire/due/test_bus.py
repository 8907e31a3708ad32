"""The Due driver against the firmware on a pty: handshake, resets, line faults, homing, commands."""

from __future__ import annotations

import json
import math
import os
import pty
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from contid.cli.commands.firmware import command as firmware_command
from contid.cli.commands.home import command as home_command
from contid.control.engine.clock import RealClock
from contid.errors import DeviceError, DeviceLostError, DeviceNotFoundError
from contid.hal import AxisOnBus, Rest, load_driver
from contid.robot_file.load import load_robot_file
from contid_drivers.due.bus import DueBus
from contid_drivers.due.emulator import DueEmulator
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, EndStop, Role
from contid_drivers.due.service import doctor, home, park
from contid_drivers.due.session import ask_hello

pytestmark = pytest.mark.realtime

MOTORS = [
    AxisOnBus(f"arm.l{i}", DueAxisOptions.model_validate({"channel": f"m{i}", "power_up_deg": 90.0}), None)
    for i in range(3)
]
PARKED = {"power_up_deg": 229.2, "homing": {"direction": -1, "at_deg": 199.2}}
AIR = {"calibration": [[0, 0], [100, 3]], "readback": [[600, 0], [3000, 3]], "ceiling_bar": 1.6}


@pytest.fixture
def world(tmp_path: Path) -> Iterator[Callable[..., tuple[DueBus, DueEmulator]]]:
    """Makes a bus and the board behind it: ``world(axes, **bus options)``."""
    with ExitStack() as stack:

        def make(axes=MOTORS, role=Role.MOTOR, **keys) -> tuple[DueBus, DueEmulator]:
            options = DueBusOptions(port=str(tmp_path / "board"), role=role, **{"latency_ms": 60.0, **keys})
            emulator = stack.enter_context(DueEmulator(options, axes))
            bus = DueBus("board", options, axes, RealClock())
            stack.callback(bus.close)
            return bus, emulator

        yield make


def settle(bus: DueBus, seconds: float, commands=None):
    end = time.monotonic() + seconds
    while True:
        samples = bus.exchange(commands or {})
        if time.monotonic() > end:
            return samples
        time.sleep(0.005)


def test_hello_and_first_samples(world):
    bus, _ = world()
    bus.open()
    assert bus.hello.role_name == "motor"
    assert bus.hello.pins == "emulated"
    samples = bus.exchange({})
    assert all(sample.valid for sample in samples.values())
    assert [sample.value for sample in samples.values()] == pytest.approx([math.pi / 2] * 3, abs=1e-3)


def test_wrong_role_is_named(world):
    _, emulator = world()
    axes = [AxisOnBus("arm.p", DueAxisOptions.model_validate({"channel": "p0", **AIR}), None)]
    options = DueBusOptions(port=str(emulator.port), role=Role.PRESSURE)
    with pytest.raises(DeviceNotFoundError, match=r"expected a pressure board.*found a motor board"):
        DueBus("air", options, axes, RealClock()).open()


def test_no_port_and_no_board(tmp_path):
    options = DueBusOptions(port=str(tmp_path / "none*"), role=Role.MOTOR, hello_ms=100)
    with pytest.raises(DeviceNotFoundError, match="no port"):
        DueBus("board", options, MOTORS, RealClock()).open()
    master, slave = pty.openpty()
    try:
        options = DueBusOptions(port=os.ttyname(slave), role=Role.MOTOR, hello_ms=150)
        with pytest.raises(DeviceNotFoundError, match=r"no hello .* within 150 ms .*contid firmware flash"):
            DueBus("board", options, MOTORS, RealClock()).open()
    finally:
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize(("fault", "cause"), [("reset", "pin"), ("brown_out", "brown-out")])
def test_an_unannounced_reset_is_a_loss_and_the_position_must_be_confirmed(world, fault, cause):
    bus, emulator = world()
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    settle(bus, 0.3, dict.fromkeys(bus.axes, 2.5))
    emulator.fault(fault)
    with pytest.raises(DeviceLostError, match=f"reset.*{cause}"):
        settle(bus, 2.0, dict.fromkeys(bus.axes, 2.5))
    with pytest.raises(DeviceLostError):
        bus.exchange({})
    bus.open()
    samples = bus.exchange({})
    assert all("position lost" in sample.fault for sample in samples.values())
    with pytest.raises(DeviceError, match="position lost"):
        bus.enable(bus.axes)
    bus.clear_fault(bus.axes)
    with pytest.raises(DeviceError, match="position lost"):
        bus.enable(bus.axes)
    bus.close()
    # Another process is no better off: the board itself refuses.
    options = DueBusOptions(port=str(emulator.port), role=Role.MOTOR, latency_ms=60.0)
    other = DueBus("board", options, MOTORS, RealClock())
    other.open()
    other.exchange({})
    with pytest.raises(DeviceError, match="position lost"):
        other.enable(other.axes)
    other.close()
    assert all("position lost" in axis.message for axis in doctor("board", options, MOTORS)[-3:])
    reported: list[str] = []
    park("board", options, MOTORS, [axis.name for axis in MOTORS], reported.append)
    assert reported[0] == "arm.l0: parked at 90 deg (reads 90.00)"
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    assert not any(sample.fault for sample in bus.exchange({}).values())


def test_a_power_cycle_under_a_live_host_loses_the_position_for_every_host(world):
    bus, emulator = world()
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    settle(bus, 0.3, dict.fromkeys(bus.axes, 2.5))
    first = bus.hello
    emulator.fault("power_cycle")
    with pytest.raises(DeviceLostError, match="reset"):
        settle(bus, 2.0, dict.fromkeys(bus.axes, 2.5))
    bus.open()
    # Nothing but the random id differs from the first start.
    assert (bus.hello.boot, bus.hello.cause) == (first.boot, first.cause)
    assert all("position lost" in sample.fault for sample in bus.exchange({}).values())
    bus.close()
    options = DueBusOptions(port=str(emulator.port), role=Role.MOTOR, latency_ms=60.0)
    assert ask_hello("board", options).position_lost
    other = DueBus("board", options, MOTORS, RealClock())
    other.open()
    other.exchange({})
    with pytest.raises(DeviceError, match="position lost"):
        other.enable(other.axes)
    other.close()


@pytest.mark.parametrize(
    "changed", [{"power_up_deg": 80.0}, {"power_up_deg": 90.0, "encoder_reversed": True}]
)
def test_a_configuration_that_changes_what_a_count_means_loses_the_position(world, changed):
    bus, emulator = world()
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    settle(bus, 0.3, dict.fromkeys(bus.axes, 2.5))
    bus.disable(bus.axes, Rest.RELAX)
    bus.close()
    axes = [AxisOnBus("arm.l0", DueAxisOptions.model_validate({"channel": "m0", **changed}), None)]
    other = DueBus(
        "board", DueBusOptions(port=str(emulator.port), role=Role.MOTOR, latency_ms=60.0), axes, RealClock()
    )
    other.open()
    assert "position lost" in other.exchange({})["arm.l0"].fault
    other.close()


def test_a_reset_by_the_watchdog_after_a_frozen_loop(world):
    bus, emulator = world()
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    emulator.fault("freeze")
    with pytest.raises(DeviceLostError, match="watchdog"):
        settle(bus, 3.0)


def test_a_loop_frozen_for_a_moment_costs_some_samples(world):
    bus, emulator = world(latency_ms=5.0, watchdog_ms=400)
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    emulator.fault("freeze", ms=25)  # shorter than the hardware watchdog
    end = time.monotonic() + 3.0
    valid: list[bool] = []
    while time.monotonic() < end and (False not in valid or not valid[-1]):
        valid.append(all(sample.valid for sample in bus.exchange({}).values()))
        time.sleep(0.002)
    assert False in valid
    counts = {"exchanges": 1 + len(valid), "silent": valid.count(False)}
    assert bus.answer_counts() == {**counts, "watchdog_trips": 0, "missed_edges": 0}
    assert not any(sample.fault for sample in settle(bus, 0.1).values())


def test_garbage_on_the_line_costs_samples_and_never_moves(world):
    bus, emulator = world(latency_ms=5.0, watchdog_ms=1000)
    bus.open()
    first = bus.exchange({})
    bus.enable(bus.axes)
    emulator.fault("garbage")
    goals = {axis: sample.value for axis, sample in first.items()}
    seen = [all(sample.valid for sample in bus.exchange(goals).values()) for _ in range(60)]
    emulator.fault("garbage", on=False)
    samples = settle(bus, 0.2, goals)
    assert not all(seen)
    assert all(sample.valid and not sample.fault for sample in samples.values())
    for axis, goal in goals.items():
        assert samples[axis].value == pytest.approx(goal, abs=0.02)


def test_a_board_with_another_id_is_refused_with_both_ids(world):
    expected, found = "00112233445566778899aabbccddeeff", bytes(range(0xE0, 0xF0)).hex()
    bus, _ = world(board_id=expected)
    with pytest.raises(DeviceNotFoundError, match=f"expected board {expected}.*found board {found}"):
        bus.open()
    bus, _ = world(board_id=found)
    bus.open()


def test_only_one_port_of_a_board_commands_it(world):
    bus, emulator = world()
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    emulator.command("port programming")
    with pytest.raises(DeviceLostError, match="another host commands the board through its native port"):
        bus.exchange({})
    with pytest.raises(DeviceNotFoundError, match="another host commands the board through its native port"):
        bus.open()
    time.sleep(0.2)  # the watchdog, after which nothing is armed
    bus.open()
    assert all(sample.valid for sample in bus.exchange({}).values())


def test_a_low_supply_of_the_board_is_a_fault_while_it_lasts(world):
    bus, emulator = world()
    bus.open()
    assert not any(sample.fault for sample in bus.exchange({}).values())
    emulator.fault("supply_low")
    assert all("3.3 V supply" in sample.fault for sample in settle(bus, 0.05).values())
    emulator.fault("supply_low", on=False)
    assert not any(sample.fault for sample in settle(bus, 0.05).values())


def test_samples_carry_the_time_of_the_tick_that_measured_them(world):
    bus, _ = world()
    bus.open()
    for _ in range(50):
        before = time.monotonic()
        (sample, *others) = bus.exchange({}).values()
        after = time.monotonic()
        assert all(other.time_s == sample.time_s for other in others)
        error_s = bus._session.clock.error_s
        # The tick began at most 1 ms before the request; late ticks of this machine are caught up.
        assert before - 0.001 - 2 * error_s - 0.05 <= sample.time_s <= after
        assert sample.age_s >= 0.0
        time.sleep(0.003)
    assert error_s < 0.005


def test_a_board_that_falls_silent_is_lost(world):
    bus, emulator = world(latency_ms=5.0)
    bus.open()
    bus.exchange({})
    emulator.fault("mute")
    with pytest.raises(DeviceLostError, match="no answer"):
        settle(bus, 5.0)


def test_programming_port_resets_on_open_and_hello_is_awaited(world):
    bus, _ = world(connection="programming")
    bus.open()
    assert bus.hello.boot >= 2
    assert bus.hello.cause.message == "pin"
    assert all(sample.valid for sample in bus.exchange({}).values())


def test_coming_back_to_the_same_board_keeps_it_holding(world):
    bus, emulator = world()
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    settle(bus, 0.5, dict.fromkeys(bus.axes, 2.0))
    bus.disable(bus.axes, Rest.HOLD)
    bus.close()
    time.sleep(0.3)
    bus.open()
    samples = bus.exchange({})
    assert [sample.value for sample in samples.values()] == pytest.approx([2.0] * 3, abs=0.01)
    assert emulator.command("get 0").split()[4] == "2"  # still under power


def test_demand_beyond_the_travel_ends_at_it(world):
    axes = [AxisOnBus("arm.l", DueAxisOptions(channel="m0"), (0.0, 1.0))]
    bus, _ = world(axes)
    bus.open()
    bus.exchange({})
    bus.enable(["arm.l"])
    sample = settle(bus, 0.8, {"arm.l": 50.0})["arm.l"]
    assert sample.value == pytest.approx(1.0, abs=0.01)


def test_home_and_doctor(world):
    homing = EndStop(direction=-1, at_deg=-20.0, at_mm=49.0, speed_deg_s=180.0)
    axes = [
        AxisOnBus("arm.l1", DueAxisOptions(channel="m0", homing=homing), None),
        AxisOnBus("arm.l2", DueAxisOptions(channel="m1"), None),
    ]
    bus, emulator = world(axes)
    options = DueBusOptions(port=str(emulator.port), role=Role.MOTOR, latency_ms=60.0)
    assert all(finding.ok for finding in doctor("board", options, axes))
    reported: list[str] = []
    (homed,) = home("board", options, axes, ["arm.l1"], reported.append)
    assert (homed.axis, homed.at_mm) == ("arm.l1", 49.0)
    assert homed.value == pytest.approx(math.radians(-20.0))
    assert reported
    with pytest.raises(DeviceError, match="no homing"):
        home("board", options, axes, ["arm.l2"], reported.append)
    bus.open()
    assert bus.exchange({})["arm.l1"].value == pytest.approx(math.radians(-15.0), abs=0.01)
    bus.enable(bus.axes)


def test_doctor_without_a_board(tmp_path):
    options = DueBusOptions(port=str(tmp_path / "none"), role=Role.MOTOR)
    (finding,) = doctor("board", options, MOTORS)
    assert not finding.ok
    assert finding.remedy


def test_emulator_of_the_driver_follows_its_control_file(tmp_path):
    driver: Any = load_driver("due")
    options = DueBusOptions(port=str(tmp_path / "board"), role=Role.MOTOR, latency_ms=60.0)
    control = tmp_path / "faults"
    control.touch()
    with driver.emulator("motors", options, MOTORS, control) as reported:
        assert "m2 arm.l2" in reported[0]
        bus = driver.open_bus("motors", options, MOTORS, RealClock())
        bus.open()
        bus.exchange({})
        bus.enable(bus.axes)
        with control.open("a") as stream:
            stream.write(json.dumps({"fault": "bridge", "channel": 1}) + "\nnonsense\n")
        end = time.monotonic() + 10.0
        while not (fault := bus.exchange({})["arm.l1"].fault) and time.monotonic() < end:
            time.sleep(0.005)
        assert "H-bridge" in fault
        bus.close()
    assert "nonsense" in (tmp_path / "faults.errors").read_text()
    assert not Path(options.port).exists()


def test_firmware_command(world, tmp_path, configs):
    run = CliRunner().invoke
    built = run(firmware_command, ["build"])
    assert built.exit_code == 0, built.output
    assert "KB flash" in built.output
    flashing = run(firmware_command, ["flash", "/dev/ttyACM0", "--dry-run"])
    assert "arduino-cli upload --fqbn arduino:sam:arduino_due_x_dbg --port /dev/ttyACM0" in flashing.output
    binary = tmp_path / "contid_due.bin"
    binary.touch()
    flashing = run(firmware_command, ["flash", "/dev/ttyACM0", "--binary", str(binary), "--dry-run"])
    assert "bossac --port=ttyACM0 -U false -e -w -v -b" in flashing.output
    _, emulator = world()
    file = tmp_path / "arm.yaml"
    text = (configs / "trirack.emulated.yaml").read_text().replace("./trirack.tty", str(emulator.port))
    file.write_text(text)
    result = run(firmware_command, ["info", str(file)])
    assert result.exit_code == 0, result.output
    assert "role motor, firmware 1.2.0 (built by hand), chip e0e1" in result.output


def test_parked_by_command(world, tmp_path, configs):
    _, emulator = world(
        [AxisOnBus(f"arm.s1.l{i + 1}", DueAxisOptions(channel=f"m{i}")) for i in range(3)]  # type: ignore[arg-type]
    )
    text = (configs / "trirack.emulated.yaml").read_text().replace("./trirack.tty", str(emulator.port))
    file = tmp_path / "arm.yaml"
    file.write_text(text)
    emulator.fault("brown_out")
    shown = CliRunner().invoke(firmware_command, ["info", str(file)])
    assert "position lost" in shown.output
    done = CliRunner().invoke(home_command, [str(file), "--parked"], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert done.output.count("parked at 229.183 deg (reads 229.15)") == 3
    shown = CliRunner().invoke(firmware_command, ["info", str(file)])
    assert "position lost" not in shown.output
    refused = CliRunner().invoke(home_command, [str(file), "arm.s1.l9", "--parked"])
    assert "no axis 'arm.s1.l9'" in str(refused.exception)


def test_home_command_writes_the_zero_of_an_axis_with_a_dotted_name(world, tmp_path, configs):
    homing = "{direction: -1, at_deg: 199.2, at_mm: 43.5, speed_deg_s: 180}"
    _, emulator = world(
        [AxisOnBus("arm.s1.l1", DueAxisOptions.model_validate({"channel": "m0", **PARKED}), None)]
    )
    text = (configs / "trirack.emulated.yaml").read_text().replace("./trirack.tty", str(emulator.port))
    file = tmp_path / "arm.yaml"
    file.write_text(text.replace("channel: m0, ", f"channel: m0, homing: {homing}, "))
    done = CliRunner().invoke(home_command, [str(file)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    axis = load_robot_file(file).file.robots["arm"].axes["s1.l1"]
    # 360 * 43.5 / 78.54 is 199.39 degrees: what the stop's angle lacks of it is the zero.
    assert axis.zero_deg == pytest.approx(199.2 - 360.0 * 43.5 / 78.53981633974483, abs=1e-3)
