"""`contid doctor` on the emulated bus: what a person must do, and what arming changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from contid_devices.dynamixel import TOOLS
from contid_devices.dynamixel.doctor import exchanges
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.client import ServoClient, ServoRefusedError
from contid_drivers.dynamixel.port import ServoPort
from contid_emulate.dynamixel import Servo

pytestmark = pytest.mark.realtime


def doctor(r: Any) -> dict[str, Any]:
    findings = TOOLS.doctor("servos", r.options, r.axes)
    return {finding.subject: finding for finding in findings}


@pytest.mark.process
def test_problems_of_a_person_have_a_remedy(rig: Callable[..., Any]) -> None:
    made = [Servo(1), Servo(2, firmware=44), Servo(2, position_ticks=77.0), Servo(8)]
    r = rig(3, made=made)
    r.emulator.set("overload", 1)
    r.emulator.servo(1).supply_decivolt = 36
    findings = doctor(r)
    wrong = {subject for subject, finding in findings.items() if not finding.ok}
    assert "remove what blocks its shaft" in findings["id 1 hardware error"].remedy
    assert wrong == {"id 1 voltage", "id 1 hardware error", "id 2 (r.a2) answers", "id 3 (r.a3)"}
    assert all(finding.remedy for finding in findings.values() if not finding.ok)
    assert "two servos have this id" in findings["id 2 (r.a2) answers"].message
    assert "8" in findings["servos others"].message


@pytest.mark.process
@pytest.mark.parametrize(("volts", "ok"), [(5.0, True), (6.0, True), (6.5, False), (3.6, False)])
def test_a_supply_beyond_that_of_the_manual_is_found(rig: Callable[..., Any], volts: float, ok: bool) -> None:
    """XL330: 3.7 to 6.0 V (e-manual, Specifications); the servo itself objects above 7.0 V only."""
    r = rig(1)
    r.emulator.servo(1).supply_decivolt = round(10 * volts)
    assert doctor(r)["id 1 voltage"].ok == ok


@pytest.mark.process
def test_a_setting_that_older_firmware_lacks_is_no_problem(
    rig: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """XL330 before firmware 46 have no Startup Configuration; arming leaves it out, and so does this."""
    read = ServoClient.read

    def of_older_firmware(client: ServoClient, device: int, register: reg.Register) -> int:
        if register is reg.STARTUP:
            raise ServoRefusedError(client.name(device), "reading register 60 was refused: access error")
        return read(client, device, register)

    monkeypatch.setattr(ServoClient, "read", of_older_firmware)
    findings = doctor(rig(2))
    assert [finding.message for finding in findings.values() if not finding.ok] == []
    assert "id 2 settings" in findings


@pytest.mark.process
def test_what_arming_changes_is_a_warning_until_torque_locks_it(rig: Callable[..., Any]) -> None:
    r = rig(1)
    servo = r.emulator.servo(1)
    servo.put(reg.RETURN_DELAY, 250)
    servo.put(reg.OPERATING_MODE, 3)
    found = doctor(r)["id 1 settings"]
    assert (found.ok, found.warning) == (True, True)
    assert found.message == "return delay time is 250, not 0, operating mode is 3, not 4"
    servo.put(reg.TORQUE_ENABLE, 1)
    found = doctor(r)["id 1 settings"]
    assert not found.ok
    assert "relax it" in found.remedy
    servo.put(reg.TORQUE_ENABLE, 0)
    r.bus.open()
    r.bus.enable(r.bus.axes)
    r.bus.close()
    found = doctor(r)["id 1 settings"]
    assert (found.ok, found.warning, found.message) == (True, False, "as in the robot file")


def test_an_old_firmware_is_a_warning(rig: Callable[..., Any]) -> None:
    found = doctor(rig(1, servo={"firmware": 44}))["id 1 firmware"]
    assert (found.ok, found.warning) == (True, True)


def test_a_servo_that_answers_pings_only_is_named_and_made_to_answer(
    rig: Callable[..., Any], caplog: pytest.LogCaptureFixture
) -> None:
    r = rig(1)
    r.emulator.servo(1).put(reg.STATUS_RETURN_LEVEL, 0)
    found = doctor(r)["id 1 (r.a1)"]
    assert (found.ok, found.warning) == (True, True)
    assert "Status Return Level (68) is 0" in found.message
    r.bus.open()
    assert "Status Return Level is 0" in caplog.text
    assert r.emulator.servo(1).get(reg.STATUS_RETURN_LEVEL) == 2
    assert r.tick()["r.a1"].valid


def test_nothing_is_wrong_with_a_good_bus(rig: Callable[..., Any]) -> None:
    assert all(finding.ok for finding in doctor(rig(2)).values())


@pytest.mark.process
@pytest.mark.parametrize(
    ("switch", "values", "counted", "remedy"),
    [
        ("late", {"ms": 9}, "late", "latency timer"),
        ("corrupt", {"device": 2, "count": 40}, "broken", "cable"),
        ("drop", {"device": 2, "count": 40}, "silent", "supply"),
    ],
)
def test_answers_of_exchanges_are_counted_by_what_became_of_them(
    rig: Callable[..., Any], switch: str, values: dict[str, Any], counted: str, remedy: str
) -> None:
    # A busy machine answers late, too, but seldom later than this.
    r = rig(2, usb_latency_ms=3 if switch == "late" else 40, slack_ms=0)
    port = ServoPort("servos", r.emulator.port, r.options.baud, 0.02)
    try:
        client = ServoClient("servos", port)
        r.emulator.set(switch, **values)
        (found,) = exchanges(client, (1, 2), r.options)
    finally:
        port.close()
    assert (found.ok, found.warning) == (True, True)
    assert remedy in found.remedy
    words = found.message.replace(",", "").split()
    assert int(words[words.index(counted) - 1]) >= 20


def test_the_owner_of_the_port_is_named(rig: Callable[..., Any]) -> None:
    r = rig(1)
    r.bus.open()
    assert "in use" in doctor(r)["servos port"].message


def test_what_other_programs_leave_is_cured_or_named(rig: Callable[..., Any]) -> None:
    r = rig(1, made=[Servo(1), Servo(7)])
    assert doctor(r)["id 1 limits"].message == "those of a new servo"
    servo = r.emulator.servo(1)
    servo.put(reg.SECONDARY_ID, 2)
    servo.put(reg.GOAL_PWM, 100)
    servo.put(reg.SHUTDOWN, 0x10)
    servo.put(reg.PWM_LIMIT, 400)
    servo.put(reg.TEMPERATURE_LIMIT, 100)
    r.emulator.servo(7).put(reg.SECONDARY_ID, 1)
    findings = doctor(r)
    settings, limits, others = (
        findings[f"{each}"] for each in ("id 1 settings", "id 1 limits", "servos others")
    )
    assert "secondary id is 2, not 255" in settings.message
    assert "goal pwm is 100, not 400" in settings.message
    assert limits.warning
    assert "overheated, overload" in limits.message
    assert "write 1 shutdown 52" in limits.remedy
    assert "pwm limit (36) is 400 of 885" in limits.message
    assert "temperature limit (31) is 100 deg C" in limits.message
    assert not others.ok
    assert "id 7 has the secondary id (12) 1: it moves with servo 1" in others.message
    r.bus.open()
    r.bus.enable(r.bus.axes)
    assert servo.get(reg.SECONDARY_ID) == 255
    assert servo.get(reg.GOAL_PWM) == 400


def test_limits_of_other_programs_are_logged_when_the_bus_opens(
    rig: Callable[..., Any], caplog: pytest.LogCaptureFixture
) -> None:
    r = rig(1)
    r.bus.open()
    assert "limit (" not in caplog.text
    r.bus.close()
    r.emulator.servo(1).put(reg.PWM_LIMIT, 300)
    r.bus.open()
    assert "pwm limit (36) is 300 of 885" in caplog.text
    assert "servo write 1 pwm_limit 885" in caplog.text


@pytest.mark.parametrize(
    ("bits", "asked"),
    [
        (0x01, "measure the supply"),
        (0x04, "let it cool"),
        (0x08, "replace the servo"),
        (0x10, "short circuit"),
        (0x20, "remove what blocks"),
        (0x80, "DYNAMIXEL Wizard"),
    ],
)
def test_every_hardware_error_has_its_own_remedy(bits: int, asked: str) -> None:
    everything = " ".join(map(reg.remedy_of_hardware_error, (0x01, 0x04, 0x08, 0x10, 0x20, 0x80)))
    assert asked in reg.remedy_of_hardware_error(bits)
    assert everything.count(asked) == 1


def test_a_low_voltage_asks_for_the_supply(rig: Callable[..., Any]) -> None:
    r = rig(1)
    r.bus.open()
    r.emulator.set("alert", 1, bits=0x01)
    assert "input voltage out of its limits: measure the supply" in r.tick()["r.a1"].fault
