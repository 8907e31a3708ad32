"""A servo that comes back after a brown-out or a silence, with torque: it must not drive to an old goal."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from contid.errors import DeviceError
from contid.hal import Rest
from contid_drivers.dynamixel import registers as reg
from contid_emulate.dynamixel import Servo

pytestmark = [pytest.mark.process, pytest.mark.realtime]

TICK = reg.RAD_PER_TICK
Make = Callable[..., Any]
TURNS = 5 * 4096


@pytest.fixture(params=["indirect", "plain"])
def moving(rig: Make, request: pytest.FixtureRequest) -> Any:
    """Two servos five turns up and on their way to the eighth, with torque at power-up configured."""
    plain = request.param == "plain"
    made = [Servo(1), Servo(2, firmware=53 if plain else 52)]
    r = rig(2, made=made, watchdog_ms=500, retry_ms=0, fast_read="off")
    r.bus.open()
    assert r.bus._link.indirect is not plain
    r.bus.enable(["r.a1", "r.a2"])
    r.tick(a1=TURNS * TICK, a2=TURNS * TICK)
    r.until(lambda: all(abs(r.emulator.servo(i).position_ticks - TURNS) < 1 for i in (1, 2)))
    for servo in r.emulator.servos:
        servo.put(reg.STARTUP, 1)
    for _ in range(10):
        r.tick(a1=(TURNS + 9000) * TICK, a2=(TURNS + 9000) * TICK)
        time.sleep(0.005)
    assert r.emulator.servo(1).motion.velocity
    return r


def test_a_brown_out_in_motion_does_not_lead_to_the_goal_of_an_old_turn(moving: Any) -> None:
    r = moving
    r.emulator.set("brownout", 1)
    stopped = r.emulator.servo(1).position_ticks
    for _ in range(60):
        samples = r.tick(a1=(TURNS + 9000) * TICK, a2=(TURNS + 9000) * TICK)
        assert not samples["r.a1"].valid
        time.sleep(0.005)
    servo = r.emulator.servo(1)
    assert "reset itself" in samples["r.a1"].fault
    assert servo.torque
    assert abs(servo.position_ticks - stopped) < 40
    r.bus.clear_fault(["r.a1"])
    sample = r.tick()["r.a1"]
    assert sample.valid
    assert sample.value == pytest.approx(servo.position_ticks * TICK, abs=2 * TICK)
    servo.put(reg.STARTUP, 0)
    r.bus.enable(["r.a1"])
    r.tick(a1=(TURNS + 5000) * TICK)
    r.until(lambda: abs(r.emulator.servo(1).position_ticks - TURNS - 5000) < 0.01)  # at rest


@pytest.mark.process
def test_a_servo_turned_after_its_reset_keeps_the_turn_it_had_when_it_answered_first(moving: Any) -> None:
    """The servo counts on after its reset, so the first answer determines the turn for all later ones."""
    r = moving
    r.emulator.set("brownout", 1)
    r.until(lambda: r.tick()["r.a1"].fault != "")
    r.tick(3)
    r.opened.client.write(1, reg.TORQUE_ENABLE, 0)
    with r.emulator._lock:
        r.emulator.servos[0].motion.position += 4096 - 30
    r.bus.clear_fault(["r.a1"])
    value = r.tick()["r.a1"].value
    assert value == pytest.approx(r.emulator.servo(1).position_ticks * TICK, abs=2 * TICK)


def test_arming_clears_torque_at_power_up(rig: Make) -> None:
    r = rig(1)
    r.emulator.servos[0].put(reg.STARTUP, 3)
    r.bus.open()
    r.bus.enable(["r.a1"])
    assert r.emulator.servo(1).get(reg.STARTUP) == 0


def test_torque_at_power_up_is_not_left_on_under_torque(rig: Make) -> None:
    r = rig(1)
    r.bus.open()
    r.bus.enable(["r.a1"])
    r.emulator.servos[0].put(reg.STARTUP, 1)
    r.bus.close()
    r.bus.open()
    with pytest.raises(DeviceError, match="startup configuration is 1"):
        r.bus.enable(["r.a1"])


@pytest.mark.process
@pytest.mark.parametrize("rest", [Rest.RELAX, Rest.HOLD])
def test_a_rest_that_a_silent_servo_missed_is_applied_when_it_answers(rig: Make, rest: Rest) -> None:
    r = rig(2, watchdog_ms=2000)
    r.bus.open()
    r.bus.enable(["r.a1", "r.a2"])
    r.tick(a1=60000 * TICK, a2=60000 * TICK)
    r.emulator.set("silent", 1)
    r.bus.disable(["r.a1", "r.a2"], rest)
    assert r.emulator.servo(1).torque
    r.emulator.set("silent", 1, on=False)
    r.tick(3)
    servo = r.emulator.servo(1)
    assert servo.torque is (rest is Rest.HOLD)
    at = servo.position_ticks
    time.sleep(0.1)
    assert r.emulator.servo(1).position_ticks == pytest.approx(at, abs=60)
    assert at < 30000
