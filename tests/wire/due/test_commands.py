"""Homing, parking, doctor and firmware commands against the firmware on a pty."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from threading import Timer
from typing import Any

import pytest
from click.testing import CliRunner

from contid.control.engine.cycle import RealClock
from contid.errors import DeviceError
from contid.hal import AxisOnBus, Rest, load_driver
from contid.robot_file.load import load_robot_file
from contid_devices.due.board import doctor
from contid_devices.due.homing import home
from contid_devices.firmware import command as firmware_command
from contid_devices.homing.command import command as home_command
from contid_drivers.due.bus import DueBus
from contid_drivers.due.motor_options import EndStop
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from contid_emulate.due import emulate
from tests.wire.due.boards import MOTORS, PARKED

pytestmark = [pytest.mark.process, pytest.mark.realtime]


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


def test_homing_ends_when_the_channel_falls_silent(world):
    homing = EndStop(direction=-1, at_deg=-20.0, speed_deg_s=5.0)
    axes = [AxisOnBus("arm.l1", DueAxisOptions(channel="m0", homing=homing))]
    _, emulator = world(axes)
    options = DueBusOptions(port=str(emulator.port), role=Role.MOTOR, latency_ms=60.0)

    def silence_soon(_: str) -> None:
        Timer(0.5, emulator.switch, [{"fault": "silent", "channel": 0}]).start()

    with pytest.raises(DeviceError, match="does not answer"):
        home("board", options, axes, ["arm.l1"], silence_soon)


def test_a_search_that_is_stopped_is_no_reference(world, monkeypatch):
    """A stop is the one order that the board takes on its other port (firmware/PROTOCOL.md)."""
    axes = [AxisOnBus("arm.l1", DueAxisOptions(channel="m0", homing=EndStop(direction=-1, speed_deg_s=5.0)))]
    _, emulator = world(axes)
    options = DueBusOptions(port=str(emulator.port), role=Role.MOTOR, latency_ms=60.0)
    homing = DueBus.homing

    def stopped(bus: DueBus, axis: str) -> bool:
        bus.disable([axis], Rest.HOLD)
        return homing(bus, axis)

    monkeypatch.setattr(DueBus, "homing", stopped)
    with pytest.raises(DeviceError, match="search was stopped"):
        home("board", options, axes, ["arm.l1"], lambda line: None)


def test_doctor_without_a_board(tmp_path):
    options = DueBusOptions(port=str(tmp_path / "none"), role=Role.MOTOR)
    (finding,) = doctor("board", options, MOTORS)
    assert not finding.ok
    assert finding.remedy


def test_the_emulator_follows_its_control_file(tmp_path):
    driver: Any = load_driver("due")
    options = DueBusOptions(port=str(tmp_path / "board"), role=Role.MOTOR, latency_ms=60.0)
    control = tmp_path / "faults"
    control.touch()
    with emulate("motors", options, MOTORS, control) as reported:
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
    assert "role motor, firmware 1.7.2 (built by hand), chip e0e1" in result.output


def test_parked_by_command(world, tmp_path, configs):
    _, emulator = world(
        [AxisOnBus(f"arm.s1.l{i + 1}", DueAxisOptions(channel=f"m{i}")) for i in range(3)]  # type: ignore[arg-type]
    )
    text = (configs / "trirack.emulated.yaml").read_text().replace("./trirack.tty", str(emulator.port))
    file = tmp_path / "arm.yaml"
    file.write_text(text)
    emulator.switch({"fault": "brown_out"})
    shown = CliRunner().invoke(firmware_command, ["info", str(file)])
    assert "position lost" in shown.output
    for other in (["--dry-run"], ["--here"], ["--force"], ["--at-mm", "3"]):
        refused = CliRunner().invoke(home_command, [str(file), "--parked", *other])
        assert (refused.exit_code, "--parked goes alone" in refused.output) == (2, True)
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
