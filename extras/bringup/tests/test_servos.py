"""``contid bringup`` on emulated Dynamixel servos: what it cures, names, writes and leaves behind."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from contid.control.engine.wiring import wired_buses
from contid.robot_file.load import load_robot_file
from contid_bringup.command import command
from contid_devices.doctor import command as doctor
from contid_devices.dynamixel.pulses import PROBE_PWM
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.options import DynamixelBusOptions
from contid_emulate.dynamixel.bench import Bench
from contid_emulate.dynamixel.servo import Servo

pytestmark = [pytest.mark.process, pytest.mark.realtime]

CONFIG = Path(__file__).parents[3] / "configs" / "finger.emulated.yaml"
LEFT = "finger.left"


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[tuple[Path, Servo]]:
    """The shipped finger, and its left servo as other programs left it."""
    path = tmp_path / "robot.yaml"
    path.write_text(CONFIG.read_text().replace("./finger.tty", str(tmp_path / "servos")))
    (bus,) = wired_buses(load_robot_file(path))
    assert isinstance(bus.wiring.options, DynamixelBusOptions)
    bench = Bench(bus.wiring.name, bus.wiring.options, bus.axes)
    servo = bench.emulator.servos[0]
    for register, value in (
        (reg.OPERATING_MODE, 1),
        (reg.SECONDARY_ID, 2),
        (reg.TEMPERATURE_LIMIT, 95),
        (reg.SHUTDOWN, 0),
        (reg.PWM_LIMIT, PROBE_PWM),  # a bring-up was cut off
        (reg.GOAL_PWM, 50),
    ):
        servo.put(register, value)
    with bench:
        yield path, servo


def test_a_servo_is_cured_proven_measured_and_left_as_the_file_has_it(robot: tuple[Path, Servo]) -> None:
    path, servo = robot
    servo.supply_decivolt = 45  # of 5.0 V: its top speed is 0.9 of the manual's
    start = servo.position_ticks
    done = CliRunner().invoke(command, [str(path), LEFT, "--yes"])
    assert done.exit_code == 0, done.output
    assert f"{LEFT}: ok: it turns the right way" in done.output
    assert "operating mode 1 -> 4, secondary id 2 -> 255" in done.output
    assert "shutdown (63) leaves the torque on" in done.output
    assert "temperature limit (31) is 95 deg C" in done.output
    assert "supply 4.5 V" in done.output
    found = load_robot_file(path).file.bringup[LEFT]
    assert found.no_load_deg_s == pytest.approx(0.9 * 618.0, rel=0.1)
    assert (found.device, found.firmware) == ("xl330-m288", "52")
    registers = (reg.TORQUE_ENABLE, reg.OPERATING_MODE, reg.PWM_LIMIT, reg.GOAL_PWM, reg.BUS_WATCHDOG)
    assert [servo.get(each) for each in registers] == [0, 4, 885, 885, 0]
    assert abs(servo.position_ticks - start) < 45.0 * reg.TICKS_PER_DEG
    servo.put(reg.FIRMWARE, 51)
    assert f"bringup {LEFT}: its firmware is 51" in CliRunner().invoke(doctor, [str(path)]).output


def test_a_jammed_servo_is_not_proven_and_gets_no_more_than_20_percent(robot: tuple[Path, Servo]) -> None:
    path, servo = robot
    servo.jam(True)
    done = CliRunner().invoke(command, [str(path), LEFT, "--yes", "--dry-run"])
    assert done.exit_code == 4, done.output
    assert f"{LEFT}: no-count: it does not move at 20 % of its PWM" in done.output
    assert servo.get(reg.TORQUE_ENABLE) == 0
    servo.jam(False)
    servo.fail(0x04)
    done = CliRunner().invoke(command, [str(path), LEFT, "--yes", "--dry-run"])
    assert f"{LEFT}: fault-line: it reports a hardware error at rest" in done.output
    assert "hardware error: overheated: let it cool" in done.output
