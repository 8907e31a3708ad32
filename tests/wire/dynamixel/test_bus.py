"""The driver on an emulated bus: handshake, arming, exchange, rest."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from typing import Any

import pytest

from contid.errors import DeviceError, DeviceLostError, DeviceNotFoundError
from contid.hal import Rest
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.bus import DynamixelBus
from contid_emulate.dynamixel import Servo

pytestmark = pytest.mark.realtime

TICK = reg.RAD_PER_TICK
Make = Callable[..., Any]


def test_opening_reads_and_touches_neither_torque_nor_position(rig: Make) -> None:
    r = rig(3)
    r.bus.open()
    samples = r.tick()
    assert [s.value for s in samples.values()] == pytest.approx([1000 * TICK, 2000 * TICK, 3000 * TICK])
    assert all(
        s.valid and s.fault == "" and s.voltage_v == 5.0 and s.temperature_c == 25.0 for s in samples.values()
    )
    for servo in r.emulator.servos:
        assert not servo.torque
        assert servo.get(reg.GOAL_POSITION) == 0


def test_torque_comes_on_without_a_jump_and_with_the_watchdog(rig: Make) -> None:
    r = rig(2)
    r.bus.open()
    r.bus.enable(["r.a1", "r.a2"])
    r.tick(20)
    for servo, ticks in zip(r.emulator.servos, (1000, 2000), strict=True):
        assert servo.torque
        assert servo.position_ticks == ticks
        assert servo.get(reg.BUS_WATCHDOG) == 100
        assert servo.get(reg.OPERATING_MODE) == 4


def test_commands_move_enabled_axes_only_and_over_several_turns(rig: Make) -> None:
    r = rig(2)
    r.bus.open()
    r.bus.enable(["r.a1"])
    r.tick(a1=3 * 2 * math.pi, a2=0.0)
    r.until(lambda: abs(r.emulator.servo(1).position_ticks - 3 * 4096) < 1)
    assert r.emulator.servo(2).position_ticks == 2000
    assert r.tick()["r.a1"].value == pytest.approx(6 * math.pi, abs=2 * TICK)


@pytest.mark.parametrize("goal", [-131073, -131072, -1, 0x7FDFF])
def test_goals_made_of_header_bytes_arrive_intact(rig: Make, goal: int) -> None:
    r = rig(2)
    r.bus.open()
    r.bus.enable(["r.a1", "r.a2"])
    r.tick(a1=goal * TICK, a2=goal * TICK)
    assert [r.emulator.servo(i).get(reg.GOAL_POSITION) for i in (1, 2)] == [goal, goal]


def test_single_writes_and_reads_carry_header_bytes_intact(rig: Make) -> None:
    r = rig(1, servo={"firmware": 52})
    r.bus.open()
    r.bus.enable(["r.a1"])
    client = r.opened.client
    for goal in (-131073, -1, 0x0FDFFF):
        client.write(1, reg.GOAL_POSITION, goal)
        assert client.read(1, reg.GOAL_POSITION) == r.emulator.servo(1).get(reg.GOAL_POSITION) == goal


def test_answers_made_of_header_bytes_are_read_right(rig: Make) -> None:
    r = rig(1)
    servo = r.emulator.servos[0]
    r.bus.open()
    servo.motion.position = -131073.0
    servo.motion.current = -1.0
    sample = r.tick()["r.a1"]
    assert sample.value == pytest.approx(-131073 * TICK)
    assert sample.effort == pytest.approx(-0.001)


def test_settings_are_written_only_where_they_differ(rig: Make, caplog: pytest.LogCaptureFixture) -> None:
    r = rig(1, axis={"current_limit_ma": 400, "position_p": 640, "goal_current_ma": 300})
    r.bus.open()
    with caplog.at_level(logging.INFO):
        r.bus.enable(["r.a1"])
        written = [record.getMessage() for record in caplog.records if "->" in record.getMessage()]
        assert len(written) == 4
        r.bus.disable(["r.a1"], Rest.RELAX)
        caplog.clear()
        r.bus.enable(["r.a1"])
    assert not [record for record in caplog.records if "->" in record.getMessage()]
    servo = r.emulator.servo(1)
    assert [servo.get(x) for x in (reg.CURRENT_LIMIT, reg.POSITION_P, reg.GOAL_CURRENT)] == [400, 640, 300]


def test_an_eeprom_setting_under_torque_is_refused_with_a_message(rig: Make) -> None:
    r = rig(1)
    r.emulator.servos[0].put(reg.TORQUE_ENABLE, 1)
    r.bus.open()
    with pytest.raises(DeviceError, match="operating mode is 3, the robot file requires 4, and torque is on"):
        r.bus.enable(["r.a1"])
    assert r.emulator.servo(1).torque


def test_the_handshake_lists_expected_against_found(rig: Make) -> None:
    made = [Servo(1), Servo(3, model=1190), Servo(7)]
    r = rig(3, made=made)
    with pytest.raises(DeviceNotFoundError) as error:
        r.bus.open()
    message = str(error.value)
    assert "id 2 (r.a2): expected xl330-m288, found nothing" in message
    assert "id 3 (r.a3): expected xl330-m288, found xl330-m077" in message
    assert "id 7 xl330-m288 firmware 52" in message


def test_enable_is_all_or_nothing(rig: Make) -> None:
    r = rig(2)
    r.bus.open()
    r.tick()
    r.emulator.set("silent", 2)
    with pytest.raises(DeviceError, match="no answer"):
        r.bus.enable(["r.a1", "r.a2"])
    assert not r.emulator.servo(1).torque
    r.emulator.set("silent", 2, on=False)
    r.bus.enable(["r.a1", "r.a2"])


def test_hold_stops_where_it_is_and_lasts_without_anybody(rig: Make) -> None:
    r = rig(1, watchdog_ms=200)
    r.bus.open()
    r.bus.enable(["r.a1"])
    r.tick(a1=20 * math.pi)
    r.tick(3)
    r.bus.disable(["r.a1"], Rest.HOLD)
    held = r.emulator.servo(1).get(reg.GOAL_POSITION)
    time.sleep(0.4)
    servo = r.emulator.servo(1)
    assert servo.torque
    assert not servo.tripped
    assert servo.position_ticks == pytest.approx(held, abs=1)
    assert held < 10 * 4096


@pytest.mark.parametrize("rest", [Rest.RELAX, Rest.VENT])
def test_relax_is_torque_off(rig: Make, rest: Rest) -> None:
    r = rig(2)
    r.bus.open()
    r.bus.enable(["r.a1", "r.a2"])
    r.bus.disable(["r.a1", "r.a2"], rest)
    assert [servo.torque for servo in r.emulator.servos] == [False, False]
    r.bus.disable(["r.a1"], rest)


def test_closing_leaves_torque_alone_and_a_second_owner_is_refused(rig: Make) -> None:
    r = rig(1)
    r.bus.open()
    r.bus.enable(["r.a1"])
    other = DynamixelBus("other", r.options, r.axes, r.bus._clock)
    with pytest.raises(DeviceNotFoundError, match="in use by"):
        other.open()
    r.bus.close()
    r.bus.close()
    assert r.emulator.servo(1).torque
    with pytest.raises(DeviceLostError):
        r.tick()
    other.open()
    other.close()


def test_a_missing_port_names_those_there_are(rig: Make) -> None:
    r = rig(1, port="/dev/there-is-no-such-port")
    with pytest.raises(DeviceNotFoundError, match="contid scan"):
        r.bus.open()


def test_wrong_commands_are_refused_before_anything_is_sent(rig: Make) -> None:
    r = rig(1)
    r.bus.open()
    r.bus.enable(["r.a1"])
    before = r.emulator.instructions
    for bad in ({"r.a1": math.nan}, {"r.a1": math.inf}, {"r.unknown": 0.0}, {"r.a1": 1e6}):
        with pytest.raises(DeviceError):
            r.bus.exchange(bad)
    assert r.emulator.instructions == before


def test_old_firmware_is_read_plainly_with_a_warning(rig: Make, caplog: pytest.LogCaptureFixture) -> None:
    r = rig(2, servo={"firmware": 45})
    r.bus.open()
    assert "Fast Sync Read needs firmware 46" in caplog.text
    assert all(sample.valid for sample in r.tick().values())


def test_without_indirect_addresses_the_plain_block_is_read(
    rig: Make, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuses = Servo._refuses

    def without(servo: Servo, register: reg.Register, value: int) -> int:
        return 7 if register.address >= reg.INDIRECT_ADDRESS else refuses(servo, register, value)

    monkeypatch.setattr(Servo, "_refuses", without)
    r = rig(2)
    r.bus.open()
    assert "no common indirect addresses" in caplog.text
    assert [s.value for s in r.tick().values()] == pytest.approx([1000 * TICK, 2000 * TICK])
    assert r.tick()["r.a1"].voltage_v == 5.0


def test_telemetry_may_be_read_less_often_than_positions(rig: Make) -> None:
    r = rig(1, telemetry_every=4)
    r.bus.open()
    r.tick()
    r.emulator.servo(1).supply_decivolt = 47
    volts = [r.tick()["r.a1"].voltage_v for _ in range(4)]
    assert volts == [5.0, 5.0, 4.7, 4.7]


def test_current_based_mode_limits_the_current(rig: Make) -> None:
    r = rig(
        1,
        servo={"stops_ticks": (0.0, 1500.0)},
        axis={"mode": "current_based_position", "goal_current_ma": 120},
    )
    r.bus.open()
    r.bus.enable(["r.a1"])
    r.tick(a1=3000 * TICK)
    r.until(lambda: r.emulator.servo(1).position_ticks >= 1500)
    assert r.tick()["r.a1"].effort == pytest.approx(0.12)
