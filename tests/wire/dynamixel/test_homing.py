"""Homing, turn keeping, and commissioning on the emulated bus."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from contid.errors import DeviceError, DeviceNotFoundError
from contid_devices.dynamixel import TOOLS
from contid_devices.dynamixel.commission import reboot, set_baud, set_id
from contid_devices.dynamixel.scan import scan
from contid_drivers.dynamixel import registers as reg
from contid_emulate.dynamixel import Servo

pytestmark = pytest.mark.realtime

TICK = reg.RAD_PER_TICK
Make = Callable[..., Any]
STOP = {
    "method": "hard_stop", "direction": -1, "current_ma": 120, "speed_deg_s": 360, "at_mm": 5, "timeout_s": 6,
}  # fmt: skip
POSE = {"method": "single_turn", "pose_deg": 3 * 360 + 30, "plausible_deg": 20, "at_mm": 60}


def quiet(line: str) -> None:
    """Ignore the report."""


def home(r: Any, *only: str) -> Any:
    return TOOLS.home("servos", r.options, r.axes, only or ("r.a1",), quiet)


def test_a_hard_stop_is_found_with_little_current_and_left_relaxed(rig: Make) -> None:
    r = rig(1, axis={"homing": STOP}, servo={"stops_ticks": (-300.0, 1e9), "position_ticks": 700.0})
    (found,) = home(r)
    assert found.value == pytest.approx(-300 * TICK, abs=2 * TICK)
    assert found.at_mm == 5
    servo = r.emulator.servo(1)
    assert not servo.torque
    assert servo.position_ticks > -300
    assert servo.get(reg.HARDWARE_ERROR) == 0


def test_no_stop_is_an_error_and_torque_is_off(rig: Make) -> None:
    r = rig(1, axis={"homing": {**STOP, "timeout_s": 0.5}})
    with pytest.raises(DeviceError, match="no stop found"):
        home(r)
    assert not r.emulator.servo(1).torque


def test_an_interrupt_leaves_torque_off(rig: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    from contid_devices.dynamixel import homing

    def interrupted(*_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(homing, "_until_blocked", interrupted)
    r = rig(1, axis={"homing": STOP})
    with pytest.raises(KeyboardInterrupt):
        home(r)
    assert not r.emulator.servo(1).torque


def test_a_torque_that_stays_on_is_reported(
    rig: Make, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    from contid_devices.dynamixel import homing

    def silenced(*_: object) -> int:
        r.emulator.set("silent", 1)
        return 0

    monkeypatch.setattr(homing, "_until_blocked", silenced)
    r = rig(1, axis={"homing": STOP})
    with pytest.raises(DeviceError, match="no answer"):
        home(r)
    assert "torque off not confirmed by r.a1" in caplog.text


def test_homing_is_refused_while_another_program_has_the_bus_open(rig: Make) -> None:
    r = rig(2, axis={"homing": STOP})
    r.bus.open()
    with pytest.raises(DeviceNotFoundError, match="in use by"):
        home(r)


def test_the_error_of_an_axis_without_homing_names_the_key_to_add(rig: Make) -> None:
    with pytest.raises(DeviceError, match="hard_stop"):
        home(rig(1))


def test_an_axis_with_a_stop_is_refused_until_it_was_homed_since_power_up(rig: Make) -> None:
    r = rig(1, axis={"homing": STOP}, servo={"stops_ticks": (-300.0, 1e9)})
    r.bus.open()
    assert "not homed" in r.tick()["r.a1"].fault
    with pytest.raises(DeviceError, match="contid home"):
        r.bus.enable(["r.a1"])
    r.bus.close()
    home(r)
    r.bus.open()
    r.bus.clear_fault(["r.a1"])
    r.bus.enable(["r.a1"])
    r.tick()
    assert r.emulator.servo(1).torque


def test_a_stored_pose_determines_the_turn(rig: Make) -> None:
    real = 3 * 4096 + 400.0
    r = rig(1, axis={"homing": POSE}, servo={"position_ticks": real})
    r.bus.open()
    assert r.tick()["r.a1"].value == pytest.approx(real * TICK)
    r.bus.enable(["r.a1"])
    r.tick(a1=(real + 5000) * TICK)
    r.until(lambda: abs(r.emulator.servo(1).position_ticks - real - 5000) < 1)
    r.bus.close()
    # A new process finds the turn in the servo, wherever it stands now.
    r.bus._states["r.a1"].turns = 0
    r.bus.open()
    there = r.emulator.servo(1).position_ticks
    assert r.tick()["r.a1"].value == pytest.approx(there * TICK, abs=2 * TICK)


def test_an_implausible_pose_is_refused_with_a_message(rig: Make) -> None:
    r = rig(1, axis={"homing": POSE}, servo={"position_ticks": 3 * 4096 + 1500.0})
    r.bus.open()
    assert "lost its turn count" in r.tick()["r.a1"].fault
    r.bus.close()
    with pytest.raises(DeviceError, match="turn count"):
        home(r)


def test_a_position_outside_the_travel_is_refused(rig: Make) -> None:
    r = rig(1, servo={"position_ticks": 3000.0}, travel=(0.0, math.pi / 2))
    r.bus.open()
    with pytest.raises(DeviceError, match="outside its travel"):
        r.bus.enable(["r.a1"])


def test_scan_finds_ids_models_and_rates(rig: Make) -> None:
    made = [Servo(1), Servo(4, model=1190), Servo(9, baud=57600)]
    r = rig(1, made=made)
    found = scan([r.emulator.port], [1000000, 57600], quiet)
    assert [(f.baud, f.address, f.model) for f in found] == [
        (1000000, 1, "xl330-m288"),
        (1000000, 4, "xl330-m077"),
        (57600, 9, "xl330-m288"),
    ]


def test_servos_get_ids_and_rates_and_are_restarted(rig: Make) -> None:
    r = rig(2, made=[Servo(1), Servo(2)])
    port = r.emulator.port
    with pytest.raises(DeviceError, match="id 2 is taken"):
        set_id(port, 1000000, 1, 2)
    set_id(port, 1000000, 1, 5)
    assert r.emulator.servo(5).device == 5
    set_baud(port, 1000000, 5, 57600)
    with pytest.raises(DeviceError, match="no answer"):
        reboot(port, 1000000, 5)
    reboot(port, 57600, 5)
    r.emulator.servo(2).put(reg.TORQUE_ENABLE, 1)
    with pytest.raises(DeviceError, match="relax it first"):
        set_id(port, 1000000, 2, 7)
