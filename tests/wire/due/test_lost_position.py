"""What loses the position of a motor on the Due, and that it has to be confirmed."""

from __future__ import annotations

import pytest

from contid.control.engine.cycle import RealClock
from contid.errors import DeviceError, DeviceLostError
from contid.hal import AxisOnBus, Rest
from contid_devices.due.board import doctor
from contid_devices.due.homing import park
from contid_drivers.due.bus import DueBus
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from contid_drivers.due.session import ask_hello
from tests.wire.due.boards import MOTORS, settle

pytestmark = [pytest.mark.process, pytest.mark.realtime]


@pytest.mark.parametrize(("fault", "cause"), [("reset", "pin"), ("brown_out", "brown-out")])
def test_an_unannounced_reset_is_a_loss_and_the_position_must_be_confirmed(world, fault, cause):
    bus, emulator = world()
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    settle(bus, 0.3, dict.fromkeys(bus.axes, 2.5))
    emulator.switch({"fault": fault})
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
    emulator.switch({"fault": "power_cycle"})
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
