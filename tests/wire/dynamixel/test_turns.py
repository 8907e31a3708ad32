"""The count of turns after another program has used the servo."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import dynamixel_sdk as sdk
import pytest

from contid.errors import DeviceError
from contid.hal import Rest
from contid_devices.dynamixel import TOOLS
from contid_devices.dynamixel.commission import sdk_bus
from contid_drivers.dynamixel import registers as reg

pytestmark = [pytest.mark.process, pytest.mark.realtime]

TICK = reg.RAD_PER_TICK
Make = Callable[..., Any]
STOP = {
    "method": "hard_stop", "direction": -1, "current_ma": 120, "speed_deg_s": 360, "at_mm": 0, "timeout_s": 6,
}  # fmt: skip
POSE = {"method": "single_turn", "pose_deg": 90, "plausible_deg": 60, "at_mm": 0}
FAR = 3 * 4096 + 700


def another_program(r: Any, *writes: tuple[reg.Register, int]) -> None:
    """Registers written by the stock SDK while contid does not hold the port."""
    with sdk_bus(r.emulator.port, r.options.baud) as bus:
        for register, value in writes:
            bus.write(1, register, value)


def driven_far(r: Any, home: bool) -> None:
    """Home if required, then move by three turns and close the bus, torque off."""
    if home:
        TOOLS.home("servos", r.options, r.axes, ("r.a1",), lambda line: None)
    r.bus.open()
    r.bus.enable(["r.a1"])
    r.tick(a1=FAR * TICK)
    r.until(lambda: abs(r.emulator.servo(1).position_ticks - FAR) < 0.01)  # at rest
    r.opened.client.write(1, reg.TORQUE_ENABLE, 0)
    r.as_another_process()


HOMINGS = pytest.mark.parametrize("homing", [None, STOP, POSE], ids=["none", "hard_stop", "single_turn"])


@pytest.mark.process
@HOMINGS
def test_a_passage_through_position_mode_resets_the_count_and_refuses_the_axis(
    rig: Make, homing: dict[str, Any] | None
) -> None:
    r = rig(1, axis={"homing": homing}, servo={"stops_ticks": (-300.0, 1e9)})
    driven_far(r, home=homing is STOP)
    another_program(
        r,
        (reg.OPERATING_MODE, 3),
        (reg.TORQUE_ENABLE, 1),
        (reg.TORQUE_ENABLE, 0),
        (reg.OPERATING_MODE, 4),
    )
    assert int.from_bytes(r.emulator.servo(1).read(132, 4), "little") == pytest.approx(FAR % 4096, abs=2)
    r.bus.open()
    assert "another program reset its count of turns" in r.tick()["r.a1"].fault
    with pytest.raises(DeviceError, match="count of turns"):
        r.bus.clear_fault(["r.a1"])
    with pytest.raises(DeviceError, match="count of turns"):
        r.bus.enable(["r.a1"])


def test_clear_fault_does_not_replace_homing(rig: Make) -> None:
    r = rig(1, axis={"homing": STOP})
    r.bus.open()
    r.tick(3)
    with pytest.raises(DeviceError, match="contid home"):
        r.bus.clear_fault(["r.a1"])
    assert "not homed" in r.tick()["r.a1"].fault


def test_torque_in_position_mode_resets_the_count_as_well(rig: Make) -> None:
    r = rig(1)
    driven_far(r, home=False)
    another_program(r, (reg.OPERATING_MODE, 3), (reg.TORQUE_ENABLE, 1), (reg.TORQUE_ENABLE, 0))
    r.bus.open()
    assert "another program reset its count of turns" in r.tick()["r.a1"].fault


@pytest.mark.process
@HOMINGS
def test_a_change_between_modes_of_several_turns_by_the_robot_file_keeps_the_count(
    rig: Make, homing: dict[str, Any] | None
) -> None:
    """Homing uses the current-based mode, the robot file the other one."""
    r = rig(1, axis={"homing": homing}, servo={"stops_ticks": (-300.0, 1e9)})
    driven_far(r, home=homing is STOP)
    r.bus.open()
    sample = r.tick()["r.a1"]
    assert sample.fault == ""
    assert sample.value == pytest.approx(FAR * TICK, abs=2 * TICK)
    r.bus.enable(["r.a1"])
    r.tick(5)
    assert r.emulator.servo(1).position_ticks == pytest.approx(FAR, abs=2)


def test_the_stock_sdk_reads_one_turn_in_position_mode(rig: Make) -> None:
    """The emulator's rule, read by the vendor's own client: e-manual, Present Position."""
    r = rig(1, servo={"position_ticks": 2 * 4096 + 11.0})
    protocol = sdk.PacketHandler(2.0)
    with sdk_bus(r.emulator.port, r.options.baud) as bus:
        bus.write(1, reg.OPERATING_MODE, 4)
        r.emulator.servo(1).motion.position = -4096 * 3 + 20.0
        before = bus.read(1, reg.PRESENT_POSITION)
        bus.write(1, reg.OPERATING_MODE, 3)
        assert before != bus.read(1, reg.PRESENT_POSITION) == 20
        r.emulator.servo(1).motion.position += 4096
        assert bus.read(1, reg.PRESENT_POSITION) == 4096 + 20
        bus.write(1, reg.GOAL_POSITION, 20)
        bus.write(1, reg.TORQUE_ENABLE, 1)
        assert bus.read(1, reg.PRESENT_POSITION) == 20
        assert protocol.read4ByteTxRx(bus._port, 1, reg.PRESENT_POSITION.address)[0] == 20
    assert math.isclose(r.emulator.servo(1).position_ticks, -4096 * 2 + 20.0)


OFFSETS = (4096, -4096, 300)


@pytest.mark.parametrize("offset", OFFSETS)
def test_a_displaced_count_is_put_right_before_a_turn_is_taken(rig: Make, offset: int) -> None:
    """Homing Offset is added to the position (e-manual, register 20): a turn taken by it would be wrong."""
    r = rig(1, axis={"homing": {**POSE, "pose_deg": 0}}, servo={"position_ticks": 100.0})
    r.emulator.servos[0].put(reg.HOMING_OFFSET, offset)
    r.emulator.servos[0].put(reg.DRIVE_MODE, 1)
    r.bus.open()
    assert r.tick()["r.a1"].value == pytest.approx(100 * TICK)
    r.bus.enable(["r.a1"])
    samples = r.tick(3)
    assert samples["r.a1"].value == pytest.approx(100 * TICK)
    assert samples["r.a1"].fault == ""
    assert [r.emulator.servo(1).get(each) for each in (reg.HOMING_OFFSET, reg.DRIVE_MODE)] == [0, 0]
    assert r.emulator.servo(1).position_ticks == pytest.approx(100, abs=1)


@pytest.mark.parametrize(("register", "value"), [(reg.HOMING_OFFSET, 4096), (reg.DRIVE_MODE, 1)])
def test_a_displaced_count_under_torque_is_refused_by_name(
    rig: Make, register: reg.Register, value: int
) -> None:
    r = rig(1)
    r.emulator.servos[0].put(reg.OPERATING_MODE, 4)
    r.emulator.servos[0].put(register, value)
    r.emulator.servos[0].put(reg.TORQUE_ENABLE, 1)
    r.bus.open()
    assert f"{register.name} is {value}" in r.tick()["r.a1"].fault
    with pytest.raises(DeviceError, match="torque is on"):
        r.bus.clear_fault(["r.a1"])
    assert r.emulator.servo(1).get(register) == value
    r.bus.disable(["r.a1"], Rest.RELAX)
    r.bus.clear_fault(["r.a1"])
    assert r.tick()["r.a1"].value == pytest.approx(1000 * TICK)
    r.bus.enable(["r.a1"])


def test_homing_by_a_pose_measures_from_the_encoder(rig: Make) -> None:
    r = rig(1, axis={"homing": POSE}, servo={"position_ticks": 1100.0})
    r.emulator.servos[0].put(reg.HOMING_OFFSET, -250)
    (homed,) = TOOLS.home("servos", r.options, r.axes, ("r.a1",), lambda line: None)
    assert homed.value == pytest.approx(1100 * TICK, abs=2 * TICK)


@pytest.mark.parametrize("offset", OFFSETS)
def test_an_offset_by_another_program_between_two_runs_leaves_the_kept_turns_right(
    rig: Make, offset: int
) -> None:
    r = rig(1)
    driven_far(r, home=False)
    another_program(r, (reg.HOMING_OFFSET, offset))
    r.bus.open()
    assert r.tick()["r.a1"].value == pytest.approx(FAR * TICK, abs=2 * TICK)
    r.bus.enable(["r.a1"])
    assert r.tick()["r.a1"].value == pytest.approx(FAR * TICK, abs=2 * TICK)


@pytest.mark.parametrize("offset", OFFSETS)
@pytest.mark.parametrize("pause_s", [pytest.param(0.0, marks=pytest.mark.campaign), 0.2])
def test_an_offset_by_another_program_during_a_run_arms_no_wrong_turn(
    rig: Make, offset: int, pause_s: float
) -> None:
    r = rig(1)
    driven_far(r, home=False)
    r.bus.open()
    r.tick(3)
    r.emulator.servos[0].put(reg.HOMING_OFFSET, offset)  # by a second adapter
    time.sleep(pause_s)
    r.tick(3)
    for order in (r.bus.enable, r.bus.clear_fault, r.bus.enable):
        try:
            order(["r.a1"])
        except DeviceError:
            continue
        sample = r.tick(2)["r.a1"]
        if order == r.bus.enable and not sample.fault:
            assert sample.value == pytest.approx(r.emulator.servo(1).position_ticks * TICK, abs=2 * TICK)
