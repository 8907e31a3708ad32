"""Boards that come back exchanged, or restarted with an arm out."""

from __future__ import annotations

import math

import pytest

from contid.control.engine.cycle import RealClock
from contid.errors import DeviceError, DeviceNotFoundError
from contid.kit import remembered
from contid_devices.due.board import accept
from contid_devices.due.homing import park
from contid_drivers.due.bus import DueBus
from contid_drivers.due.options import DueBusOptions, Role
from tests.wire.due.boards import MOTORS, settle

pytestmark = [pytest.mark.process, pytest.mark.realtime]


@pytest.fixture(autouse=True)
def real_devices(tmp_path, monkeypatch):
    monkeypatch.setattr(remembered, "EMULATED", "/none/")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)


def again(emulator):
    """The bus of another process."""
    options = DueBusOptions(port=str(emulator.port), role=Role.MOTOR, latency_ms=60.0)
    return DueBus("board", options, MOTORS, RealClock())


def drive(bus, goal_rad, seconds=0.6):
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    settle(bus, seconds, dict.fromkeys(bus.axes, goal_rad))


def lost(bus):
    bus.open()
    return ["position lost" in sample.fault for sample in bus.exchange({}).values()]


def test_a_board_that_was_off_with_its_arm_out_has_lost_its_position(world):
    bus, emulator = world()
    drive(bus, 2.5)
    bus.close()
    emulator.switch({"fault": "power_cycle"})
    other = again(emulator)
    assert lost(other) == [True] * 3
    with pytest.raises(DeviceError, match="position lost"):
        other.enable(other.axes)
    other.close()
    # A second power cycle does not make it parked.
    emulator.switch({"fault": "power_cycle"})
    other = again(emulator)
    assert lost(other) == [True] * 3
    other.close()
    options = DueBusOptions(port=str(emulator.port), role=Role.MOTOR, latency_ms=60.0)
    park("board", options, MOTORS, [axis.name for axis in MOTORS], print)
    # Parked where it counts from: the next start needs no person.
    emulator.switch({"fault": "power_cycle"})
    other = again(emulator)
    assert lost(other) == [False] * 3
    other.close()


def test_an_opening_that_fails_does_not_make_an_arm_parked(world, monkeypatch):
    """The board does not take that its position is lost; the next process must not take it for known."""
    bus, emulator = world()
    drive(bus, 2.5)
    bus.close()
    emulator.switch({"fault": "power_cycle"})

    def silent(*_, **__):
        raise DeviceError("board", "no answer")

    other = again(emulator)
    with monkeypatch.context() as patch:
        patch.setattr(DueBus, "_park", silent)
        with pytest.raises(DeviceError, match="no answer"):
            other.open()
    other.close()
    last = again(emulator)
    assert lost(last) == [True] * 3
    last.close()


def test_a_process_that_did_not_close_leaves_the_position_unknown_after_a_start_only(world):
    bus, emulator = world()
    bus.open()
    bus.exchange({})
    bus._session.close()  # as a killed process does
    other = again(emulator)
    assert lost(other) == [False] * 3
    other._session.close()
    emulator.switch({"fault": "power_cycle"})
    last = again(emulator)
    assert lost(last) == [True] * 3
    last.close()


def test_another_board_is_refused_until_a_person_accepts_it(world, monkeypatch):
    bus, emulator = world()
    bus.open()
    bus.close()
    memory = remembered.BusMemory("board", str(emulator.port), MOTORS)
    found = memory.load()
    assert found is not None
    memory.save(remembered.Remembered(found.bus, found.port, found.axes, {"board": "00" * 16}))
    with pytest.raises(DeviceNotFoundError, match="expected the board of before, 0000") as refused:
        again(emulator).open()
    assert "--accept board" in refused.value.remedy
    options = DueBusOptions(port=str(emulator.port), role=Role.MOTOR, latency_ms=60.0)
    lines: list[str] = []
    accept("board", options, MOTORS, lines.append)
    assert found.devices["board"] in lines[0]
    other = again(emulator)
    # Where the shafts of an accepted board stand is not known.
    assert lost(other) == [True] * 3
    other.close()


def test_a_board_of_another_bus_is_refused_at_the_first_open(world):
    bus, emulator = world()
    bus.open()
    bus.close()
    memory = remembered.BusMemory("board", str(emulator.port), MOTORS)
    memory.path.unlink()
    other = remembered.BusMemory("right", "/dev/ttyACM7", MOTORS)
    other.save(remembered.Remembered("right", "/dev/ttyACM7", ("x",), {"board": bus_id(emulator)}))
    with pytest.raises(DeviceNotFoundError, match="belongs to bus right at /dev/ttyACM7"):
        again(emulator).open()


def bus_id(emulator):
    bus = again(emulator)
    bus.open()
    found = bus.hello.unique_id
    bus.close()
    remembered.BusMemory("board", str(emulator.port), MOTORS).path.unlink()
    return found


def test_a_position_that_is_lost_stays_lost_beside_another_fault(world):
    """The axis that misses edges stands where it is parked, by a count that means nothing."""
    bus, emulator = world()
    drive(bus, math.radians(91.0))
    emulator.command("set 0 missed 50")
    assert "edges missed" in settle(bus, 0.5)["arm.l0"].fault
    bus.close()
    emulator.switch({"fault": "power_cycle"})
    other = again(emulator)
    assert lost(other) == [True, False, False]
    other.close()
