"""The driver on emulated servos of several models: where the block is, units, mixed buses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import pytest

from contid.control.engine.cycle import RealClock
from contid.hal import AxisOnBus, Rest
from contid_drivers.dynamixel import mapping
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.bus import DynamixelBus
from contid_drivers.dynamixel.models import BY_NAME
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_emulate.dynamixel import Servo

pytestmark = pytest.mark.realtime

Make = Callable[..., Any]


def bus_of(rig: Make, models: Mapping[str, int], **axis: Any) -> tuple[Any, DynamixelBus]:
    """A rig with one servo per model (and firmware), and a bus whose axes have these models."""
    made = [
        Servo(i + 1, model=BY_NAME[name].number, firmware=firmware, position_ticks=1000.0 * (i + 1))
        for i, (name, firmware) in enumerate(models.items())
    ]
    r = rig(len(made), made=made)
    axes = [
        AxisOnBus(f"r.a{i + 1}", DynamixelAxisOptions.model_validate({"id": i + 1, "model": name, **axis}))
        for i, name in enumerate(models)
    ]
    options = DynamixelBusOptions.model_validate({**r.options.model_dump(), "return_delay_us": 0})
    r.bus = DynamixelBus("servos", options, axes, RealClock())
    return r, r.bus


def follows(r: Any, bus: DynamixelBus) -> None:
    """Every axis goes half a turn from where it stands."""
    bus.open()
    bus.enable(bus.axes)
    goals = {axis: (sample.value or 0.0) + 3.0 for axis, sample in bus.exchange({}).items()}

    def there() -> bool:
        samples = bus.exchange(goals)
        return all(abs((sample.value or 0.0) - goals[axis]) < 0.01 for axis, sample in samples.items())

    r.until(there)
    samples = bus.exchange(goals)
    assert all(sample.valid and not sample.fault for sample in samples.values())
    for axis, sample in samples.items():
        servo = r.emulator.servo(int(axis[-1]))
        assert sample.voltage_v == pytest.approx(servo.model.supply_v)
        assert (sample.effort is None) is (servo.model.ma_per_unit is None)
    bus.disable(bus.axes, Rest.RELAX)
    bus.close()


@pytest.mark.process
@pytest.mark.parametrize("name", ["xl330-m077", "xc330-t288", "xl430-w250", "xm540-w270", "xh430-v350"])
def test_one_model_follows_its_goals(rig: Make, name: str) -> None:
    follows(*bus_of(rig, {name: 52}))


def test_mixed_models_share_a_bus(rig: Make) -> None:
    follows(*bus_of(rig, {"xl330-m288": 52, "xm430-w350": 52, "2xl430-w250": 45, "xc430-w150": 46}))


@pytest.mark.parametrize("firmware", [52, 53])
def test_the_block_of_a_small_servo_is_where_its_firmware_has_it(
    rig: Make, firmware: int, caplog: pytest.LogCaptureFixture
) -> None:
    r, bus = bus_of(rig, {"xl330-m288": firmware})
    follows(r, bus)
    assert "no common indirect addresses" not in caplog.text


@pytest.mark.parametrize("firmware", [52, 53])
def test_the_block_is_found_by_what_it_holds(
    rig: Make, firmware: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A servo that contradicts the table, as another firmware may: no wrong register passes as a position."""
    r, bus = bus_of(rig, {"xl330-m288": firmware})
    monkeypatch.setattr(mapping, "INDIRECT_STARTS", (432 - r.emulator.servo(1).indirect_data,))
    bus.open()
    assert bus.exchange({})["r.a1"].value == pytest.approx(1000 * reg.RAD_PER_TICK)
    bus.close()


def test_currents_are_in_ma_on_every_model(rig: Make) -> None:
    r, bus = bus_of(rig, {"xm430-w350": 45, "xc330-m288": 52}, goal_current_ma=300, current_limit_ma=900)
    bus.open()
    bus.enable(bus.axes)
    for device, unit in ((1, 2.69), (2, 1.0)):
        servo = r.emulator.servo(device)
        assert servo.get(reg.GOAL_CURRENT) == int(300 / unit)
        assert servo.get(reg.CURRENT_LIMIT) == int(900 / unit)
        servo.motion.stops = (servo.position_ticks, servo.position_ticks)
    goals = {axis: (sample.value or 0.0) + 1.0 for axis, sample in bus.exchange({}).items()}
    r.until(lambda: all((s.effort or 0.0) > 0.85 for s in bus.exchange(goals).values()))
    assert [s.effort for s in bus.exchange(goals).values()] == pytest.approx([0.9, 0.9], abs=0.003)
    bus.disable(bus.axes, Rest.RELAX)
    bus.close()


def test_a_torqued_servo_that_refuses_indirect_addresses_does_not_end_the_run(
    rig: Make, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    r = rig(2)
    refuses = Servo._refuses

    def locked(servo: Servo, register: reg.Register, value: int) -> int:
        indirect = register.name.startswith("indirect address")
        return 7 if indirect and servo.torque else refuses(servo, register, value)

    monkeypatch.setattr(Servo, "_refuses", locked)
    servo = r.emulator.servo(1)
    servo.put(reg.OPERATING_MODE, 4)
    servo.put(reg.TORQUE_ENABLE, 1)
    r.bus.open()
    assert "no common indirect addresses" in caplog.text
    assert all(sample.valid and not sample.fault for sample in r.tick(times=3).values())
    r.bus.enable(r.bus.axes)
    assert r.emulator.servo(2).torque
