"""The Due driver against the firmware on a pty: handshake, line faults, supply, silence."""

from __future__ import annotations

import math
import os
import pty
import time
from pathlib import Path

import pytest

from contid.control.engine.cycle import RealClock
from contid.errors import DeviceLostError, DeviceNotFoundError
from contid.hal import AxisOnBus, Rest
from contid_drivers.due.bus import DueBus
from contid_drivers.due.codes import Type
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from tests.wire.due.boards import AIR, MOTORS, settle

pytestmark = [pytest.mark.process, pytest.mark.realtime]


def test_hello_and_first_samples(world):
    bus, _ = world()
    bus.open()
    assert bus.hello.role_name == "motor"
    assert bus.hello.pins == "emulated"
    samples = bus.exchange({})
    assert all(sample.valid for sample in samples.values())
    assert [sample.value for sample in samples.values()] == pytest.approx([math.pi / 2] * 3, abs=1e-3)


def test_wrong_role_is_named(world):
    _, emulator = world()
    axes = [AxisOnBus("arm.p", DueAxisOptions.model_validate({"channel": "p0", **AIR}), None)]
    options = DueBusOptions(port=str(emulator.port), role=Role.PRESSURE)
    with pytest.raises(DeviceNotFoundError, match=r"expected a pressure board.*found a motor board"):
        DueBus("air", options, axes, RealClock()).open()


def test_no_port_and_no_board(tmp_path):
    options = DueBusOptions(port=str(tmp_path / "none*"), role=Role.MOTOR, hello_ms=100)
    with pytest.raises(DeviceNotFoundError, match="no port"):
        DueBus("board", options, MOTORS, RealClock()).open()
    master, slave = pty.openpty()
    try:
        options = DueBusOptions(port=os.ttyname(slave), role=Role.MOTOR, hello_ms=150)
        with pytest.raises(DeviceNotFoundError, match=r"no hello .* within 150 ms .*contid firmware flash"):
            DueBus("board", options, MOTORS, RealClock()).open()
    finally:
        os.close(master)
        os.close(slave)


def test_a_reset_by_the_watchdog_after_a_frozen_loop(world):
    bus, emulator = world()
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    emulator.switch({"fault": "freeze"})
    with pytest.raises(DeviceLostError, match="watchdog"):
        settle(bus, 3.0)


def test_a_loop_frozen_for_a_moment_costs_some_samples(world):
    bus, emulator = world(latency_ms=5.0, watchdog_ms=400)
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    emulator.switch({"fault": "freeze", "ms": 25})  # shorter than the hardware watchdog
    end = time.monotonic() + 3.0
    valid: list[bool] = []
    while time.monotonic() < end and (False not in valid or not valid[-1]):
        valid.append(all(sample.valid for sample in bus.exchange({}).values()))
        time.sleep(0.002)
    assert False in valid
    counts = {"exchanges": 1 + len(valid), "silent": valid.count(False)}
    assert bus.answer_counts() == {**counts, "watchdog_trips": 0, "missed_edges": 0}
    assert not any(sample.fault for sample in settle(bus, 0.1).values())


def test_garbage_on_the_line_costs_samples_and_never_moves(world):
    bus, emulator = world(latency_ms=5.0, watchdog_ms=1000)
    bus.open()
    first = bus.exchange({})
    bus.enable(bus.axes)
    emulator.switch({"fault": "garbage"})
    goals = {axis: sample.value for axis, sample in first.items()}
    seen = [all(sample.valid for sample in bus.exchange(goals).values()) for _ in range(60)]
    emulator.switch({"fault": "garbage", "on": False})
    samples = settle(bus, 0.2, goals)
    assert not all(seen)
    assert all(sample.valid and not sample.fault for sample in samples.values())
    for axis, goal in goals.items():
        assert samples[axis].value == pytest.approx(goal, abs=0.02)


def test_a_stop_that_the_board_did_not_receive_is_repeated_when_it_answers(world, monkeypatch):
    axes = [AxisOnBus("arm.p", DueAxisOptions.model_validate({"channel": "p0", **AIR, "vent_bar_s": 20}))]
    bus, emulator = world(axes, Role.PRESSURE, watchdog_ms=5000)
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    settle(bus, 1.0, {"arm.p": 1e5})
    assert float(emulator.command("get 0").split()[2]) > 0.8e5
    session = bus._session
    lost: list[bytes] = []

    def command(kind, body, real=session.command):
        if kind is Type.STOP and len(lost) < 3:
            lost.append(body)
            return None
        return real(kind, body)

    monkeypatch.setattr(session, "command", command)
    bus.disable(bus.axes, Rest.VENT)
    assert len(lost) == 3
    sample = settle(bus, 1.0)["arm.p"]
    assert float(emulator.command("get 0").split()[2]) < 0.05e5
    assert not sample.fault


def test_a_board_with_another_id_is_refused_with_both_ids(world):
    expected, found = "00112233445566778899aabbccddeeff", bytes(range(0xE0, 0xF0)).hex()
    bus, _ = world(board_id=expected)
    with pytest.raises(DeviceNotFoundError, match=f"expected board {expected}.*found board {found}"):
        bus.open()
    bus, _ = world(board_id=found)
    bus.open()


def test_only_one_port_of_a_board_commands_it(world):
    bus, emulator = world()
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    emulator.command("port programming")
    with pytest.raises(DeviceLostError, match="another host commands the board through its native port"):
        bus.exchange({})
    with pytest.raises(DeviceNotFoundError, match="another host commands the board through its native port"):
        bus.open()
    time.sleep(0.2)  # the watchdog, after which nothing is armed
    bus.open()
    assert all(sample.valid for sample in bus.exchange({}).values())


def test_a_low_supply_of_the_board_is_a_fault_while_it_lasts(world):
    bus, emulator = world()
    bus.open()
    assert not any(sample.fault for sample in bus.exchange({}).values())
    emulator.switch({"fault": "supply_low"})
    assert all("3.3 V supply" in sample.fault for sample in settle(bus, 0.05).values())
    emulator.switch({"fault": "supply_low", "on": False})
    assert not any(sample.fault for sample in settle(bus, 0.05).values())


def test_samples_carry_the_time_of_the_tick_that_measured_them(world):
    bus, _ = world()
    bus.open()
    for _ in range(50):
        before = time.monotonic()
        (sample, *others) = bus.exchange({}).values()
        after = time.monotonic()
        assert all(other.time_s == sample.time_s for other in others)
        error_s = (bus._session.clock._high_s - bus._session.clock._low_s) / 2.0
        # The tick began at most 1 ms before the request; late ticks of this machine are caught up.
        assert before - 0.001 - 2 * error_s - 0.05 <= sample.time_s <= after
        assert sample.age_s >= 0.0
        time.sleep(0.003)
    assert error_s < 0.005


def test_a_board_that_falls_silent_is_lost(world):
    bus, emulator = world(latency_ms=5.0)
    bus.open()
    bus.exchange({})
    emulator.switch({"fault": "mute"})
    with pytest.raises(DeviceLostError, match="no answer"):
        settle(bus, 5.0)


def test_programming_port_resets_on_open_and_hello_is_awaited(world):
    bus, _ = world(connection="programming")
    bus.open()
    assert bus.hello.boot >= 2
    assert bus.hello.cause.message == "pin"
    assert all(sample.valid for sample in bus.exchange({}).values())


def test_coming_back_to_the_same_board_keeps_it_holding(world):
    bus, emulator = world()
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    settle(bus, 0.5, dict.fromkeys(bus.axes, 2.0))
    bus.disable(bus.axes, Rest.HOLD)
    bus.close()
    time.sleep(0.3)
    bus.open()
    samples = bus.exchange({})
    assert [sample.value for sample in samples.values()] == pytest.approx([2.0] * 3, abs=0.01)
    assert emulator.command("get 0").split()[4] == "2"  # still under power


def test_demand_beyond_the_travel_ends_at_it(world):
    axes = [AxisOnBus("arm.l", DueAxisOptions(channel="m0"), (0.0, 1.0))]
    bus, _ = world(axes)
    bus.open()
    bus.exchange({})
    bus.enable(["arm.l"])
    sample = settle(bus, 0.8, {"arm.l": 50.0})["arm.l"]
    assert sample.value == pytest.approx(1.0, abs=0.01)


def test_a_relax_asked_for_while_the_port_is_lost_is_done_when_it_is_back(world):
    bus, emulator = world(watchdog_ms=5000)
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    settle(bus, 0.2, dict.fromkeys(bus.axes, 2.0))
    emulator.switch({"fault": "unplug"})
    with pytest.raises(DeviceLostError):
        settle(bus, 2.0)
    bus.disable(bus.axes, Rest.RELAX)
    with pytest.raises(DeviceNotFoundError):
        bus.open()
    assert emulator.command("get 0").split()[4] == "2"
    emulator.switch({"fault": "plug"})
    while not Path(bus._options.port).exists():
        time.sleep(0.001)
    bus.open()
    settle(bus, 0.1)
    assert emulator.command("get 0").split()[4] != "2"


def test_a_relax_lets_go_a_motor_that_holds_in_its_safe_state(world):
    keys = {"channel": "m0", "on_watchdog": "hold", "start_state": "brake"}
    axes = [AxisOnBus("arm.l0", DueAxisOptions.model_validate(keys), None)]
    bus, emulator = world(axes, watchdog_ms=100)
    bus.open()
    bus.exchange({})
    bus.enable(bus.axes)
    settle(bus, 0.2, {"arm.l0": 1.0})
    time.sleep(0.3)
    assert "watchdog" in settle(bus, 0.05)["arm.l0"].fault
    assert emulator.command("get 0").split()[4] == "2"
    bus.disable(bus.axes, Rest.HOLD)
    settle(bus, 0.05)
    assert emulator.command("get 0").split()[4] == "2"
    bus.disable(bus.axes, Rest.RELAX)
    assert "watchdog" in settle(bus, 0.05)["arm.l0"].fault, "the latch stays"
    assert emulator.command("get 0").split()[4:6] == ["0", "0"]
    bus.clear_fault(bus.axes)
    assert settle(bus, 0.1)["arm.l0"].fault == ""
    assert emulator.command("get 0").split()[4] != "2"
    bus.enable(bus.axes)
    settle(bus, 0.2, {"arm.l0": 1.0})
    assert emulator.command("get 0").split()[4] == "2"
