"""A cable that is pulled and plugged in: a lost device at once, and no motion of its own afterwards."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contid.errors import DeviceError, DeviceLostError, DeviceNotFoundError
from contid.hal import Rest
from contid.kit import serial_ports
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.link import BusLink

pytestmark = [pytest.mark.process, pytest.mark.realtime]

TICK = reg.RAD_PER_TICK
Make = Callable[..., Any]


@pytest.mark.parametrize("name", [None, "renamed.pty"])
def test_unplugging_is_a_lost_device_at_once_and_plugging_in_needs_no_restart(
    rig: Make, tmp_path: Path, name: str | None
) -> None:
    r = rig(2, port=str(tmp_path / "*.pty"))
    r.bus.open()
    r.bus.enable(["r.a1", "r.a2"])
    r.tick(3, a1=1010 * TICK)
    r.emulator.set("unplug")
    for _ in range(3):
        with pytest.raises(DeviceLostError):
            r.tick(a1=1020 * TICK)
    with pytest.raises(DeviceLostError):
        r.bus.enable(["r.a1"])
    r.bus.disable(["r.a1", "r.a2"], Rest.RELAX)
    with pytest.raises(DeviceNotFoundError):
        r.bus.open()
    r.emulator.set("replug", port=str(tmp_path / name) if name else None)
    r.bus.open()
    before = [servo.position_ticks for servo in r.emulator.servos]
    r.tick(10, a1=5000 * TICK, a2=5000 * TICK)
    # At most the rest of the last command is still under way; nothing new is taken.
    assert [servo.position_ticks for servo in r.emulator.servos] == pytest.approx(before, abs=12)
    r.bus.clear_fault(["r.a1", "r.a2"])
    r.bus.enable(["r.a1", "r.a2"])
    r.tick(10)
    assert [servo.position_ticks for servo in r.emulator.servos] == pytest.approx(before, abs=12)


@pytest.mark.process
def test_the_watchdog_that_tripped_during_an_unplug_is_reported_and_not_armed_over(
    rig: Make, tmp_path: Path
) -> None:
    r = rig(1, watchdog_ms=40)
    r.bus.open()
    r.bus.enable(["r.a1"])
    r.tick(a1=1010 * TICK)
    r.emulator.set("unplug")
    with pytest.raises(DeviceLostError):
        r.tick()
    time.sleep(0.2)
    r.emulator.set("replug")
    r.bus.open()
    assert "Bus Watchdog tripped" in r.tick()["r.a1"].fault
    with pytest.raises(DeviceError, match="Bus Watchdog"):
        r.bus.enable(["r.a1"])
    r.bus.clear_fault(["r.a1"])
    r.bus.enable(["r.a1"])


@pytest.mark.process
def test_a_cable_pulled_at_the_end_of_open_leaves_the_bus_lost(
    rig: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    r = rig(1)

    def pulled(link: BusLink) -> bool:
        r.emulator.set("unplug")
        return bool(link.need_open().cyclic.run({}, full=True))

    with monkeypatch.context() as patch:
        patch.setattr(BusLink, "probe_fast", pulled)
        with pytest.raises(DeviceLostError):
            r.bus.open()
    with pytest.raises(DeviceNotFoundError):
        r.bus.open()
    r.emulator.set("replug")
    r.bus.open()
    assert r.tick()["r.a1"].valid


def test_an_adapter_is_found_again_by_its_serial_number(monkeypatch: pytest.MonkeyPatch) -> None:
    class Port:
        device, vid, pid, serial_number = "/dev/ttyUSB7", 0x0403, 0x6014, "FT123"

    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [Port])
    known = serial_ports.identity_of("/dev/ttyUSB7")
    assert known is not None
    assert serial_ports.find_port("servos", "/dev/ttyUSB0-gone", known) == "/dev/ttyUSB7"
    with pytest.raises(DeviceNotFoundError, match="/dev/ttyUSB7"):
        serial_ports.find_port("servos", "/dev/ttyUSB0-gone")
