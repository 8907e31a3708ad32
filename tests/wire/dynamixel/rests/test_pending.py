"""A rest that a servo did not confirm stays asked for, whatever happens before it answers again."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from contid.errors import DeviceError, DeviceLostError, DeviceNotFoundError
from contid.hal import Rest
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel import turns
from contid_drivers.dynamixel.axis import Axis, TorqueState
from contid_drivers.dynamixel.client import ServoClient
from contid_emulate.dynamixel import Servo, replies, wire
from tests.wire.dynamixel.virtual_wire import servo_time

Make = Callable[..., Any]
TICK = reg.RAD_PER_TICK
BOTH = ["r.a1", "r.a2"]


def running(rig: Make, **options: Any) -> Any:
    """Two enabled servos."""
    r = rig(**options)
    r.bus.open()
    r.bus.enable(BOTH)
    r.tick(2)
    return r


def silent_while_relaxed(r: Any) -> None:
    """Servo 1 misses a relax, and answers again; its torque is on."""
    r.emulator.set("silent", 1)
    r.bus.disable(["r.a1"], Rest.RELAX)
    r.emulator.set("silent", 1, on=False)
    assert r.emulator.servo(1).torque


@pytest.mark.realtime
def test_clear_fault_finishes_a_pending_relax(rig: Make) -> None:
    r = running(rig)
    silent_while_relaxed(r)
    r.bus.clear_fault(["r.a1"])
    assert not r.emulator.servo(1).torque


@pytest.mark.realtime
def test_clear_fault_is_refused_while_a_relax_is_not_confirmed(
    rig: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    r = running(rig)
    silent_while_relaxed(r)
    with monkeypatch.context() as deaf:  # its torque stays on, whatever is written
        write = Servo.write
        deaf.setattr(
            Servo,
            "write",
            lambda servo, at, data: 0 if at == 64 and servo.device == 1 else write(servo, at, data),
        )
        with pytest.raises(DeviceError, match=r"r\.a1.*torque off is not confirmed"):
            r.bus.clear_fault(["r.a1"])
    r.tick(2)
    assert not r.emulator.servo(1).torque


@pytest.mark.realtime
def test_arming_finishes_a_pending_relax_first_and_a_refused_arming_leaves_it_so(rig: Make) -> None:
    r = running(rig)
    silent_while_relaxed(r)
    r.emulator.set("silent", 2)
    r.bus.disable(["r.a2"], Rest.HOLD)
    with pytest.raises(DeviceError, match=r"r\.a2"):
        r.bus.enable(BOTH)
    r.emulator.set("silent", 2, on=False)
    r.tick(3)
    assert not r.emulator.servo(1).torque
    assert r.emulator.servo(2).torque


@pytest.mark.realtime
@pytest.mark.parametrize("reopened_in_vain", [False, True])
@pytest.mark.parametrize("rest", [Rest.RELAX, Rest.HOLD])
def test_a_rest_asked_for_while_the_port_is_lost_is_done_when_it_is_back(
    rig: Make, rest: Rest, reopened_in_vain: bool
) -> None:
    r = running(rig, watchdog_ms=60)
    r.tick(a1=60000 * TICK, a2=60000 * TICK)
    r.emulator.set("unplug")
    with pytest.raises(DeviceLostError):
        r.tick()
    if reopened_in_vain:
        with pytest.raises(DeviceNotFoundError):
            r.bus.open()
    r.bus.disable(BOTH, rest)
    time.sleep(0.2)  # the watchdogs trip, with torque on
    r.emulator.set("replug")
    r.bus.open()
    r.tick(3)
    assert [r.emulator.servo(i).torque for i in (1, 2)] == [rest is Rest.HOLD] * 2
    stopped = [r.emulator.servo(i).position_ticks for i in (1, 2)]
    r.tick(3)
    assert [r.emulator.servo(i).position_ticks for i in (1, 2)] == pytest.approx(stopped, abs=12)


@pytest.mark.realtime
def test_a_port_that_goes_during_a_relax_loses_none_of_it(rig: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    r = running(rig)
    port = r.opened.client.port
    send = port.send

    def gone(wire: bytes) -> float:
        monkeypatch.setattr(port, "send", send)
        raise DeviceLostError("servos", "the port is gone")

    monkeypatch.setattr(port, "send", gone)
    r.bus.disable(BOTH, Rest.RELAX)
    with pytest.raises(DeviceLostError):
        r.tick()
    assert all(servo.torque for servo in r.emulator.servos)
    r.bus.open()
    r.tick(2)
    assert not any(servo.torque for servo in r.emulator.servos)


def test_a_hold_after_a_fault_is_sent_until_it_is_confirmed(
    rig: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A jammed servo pushes on towards its old goal until a new one arrives."""
    r = rig(2, axis={"following_error_ms": 100.0})
    r.bus.open()
    r.bus.enable(BOTH)
    r.tick()
    r.emulator.set("jam", 1)
    axis, write = r.bus._states["r.a1"], Servo.write
    lost: list[bytes] = []

    def noisy(servo: Servo, address: int, data: bytes) -> Any:
        if servo.device == 1 and address == reg.GOAL_POSITION.address and axis.fault and len(lost) < 3:
            lost.append(data)
            return 0
        return write(servo, address, data)

    monkeypatch.setattr(Servo, "write", noisy)
    for step in range(80):
        r.tick(a1=(1000 + 100 * step) * TICK)
        time.sleep(0.01)
    assert "does not follow" in axis.fault
    assert len(lost) == 3
    servo = r.emulator.servos[0]
    assert servo.get(reg.GOAL_POSITION) == pytest.approx(servo.position_ticks, abs=2)


def test_a_rest_that_is_not_confirmed_costs_a_tick_one_time_out(
    rig: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The servo answers the reads of the tick, and no other: the rest of the bus goes on."""
    clock = servo_time(monkeypatch)
    r = rig(2, time=clock, usb_latency_ms=4.0, retry_ms=2.0)
    r.bus.open()
    r.bus.enable(BOTH)
    r.tick(2)
    silent_while_relaxed(r)
    act = replies._act

    def deaf(packet: Any, servo: Servo) -> Any:
        if servo.device == 1 and packet.instruction == 2:
            raise LookupError
        return act(packet, servo)

    def unanswered(packet: Any, servos: Any, byte_s: float) -> list[Any]:
        try:
            return answers(packet, servos, byte_s)
        except LookupError:
            return []

    answers = replies.answers
    monkeypatch.setattr(replies, "_act", deaf)
    monkeypatch.setattr(wire, "answers", unanswered)
    took_ms = []
    for _ in range(5):
        begin = clock.now()
        samples = r.tick(a2=2010 * TICK)
        took_ms.append(1e3 * (clock.now() - begin))
        assert samples["r.a2"].valid
    assert max(took_ms) < 10.0
    monkeypatch.setattr(replies, "_act", act)
    r.tick(3)
    assert not r.emulator.servos[0].torque


@pytest.mark.realtime
def test_a_servo_that_lost_its_power_while_the_port_was_lost_keeps_the_turn_it_settles_in(rig: Make) -> None:
    r = running(rig)
    known = r.tick()["r.a1"].value
    r.emulator.set("unplug")
    with pytest.raises(DeviceLostError):
        r.tick()
    r.emulator.set("brownout", 1)
    time.sleep(0.3)
    r.emulator.set("replug")
    r.bus.open()
    for _ in range(3):
        sample = r.tick()["r.a1"]
        assert (sample.fault, sample.valid) == ("", True)
        assert sample.value == pytest.approx(known, abs=2 * TICK)


@pytest.mark.realtime
def test_a_port_that_goes_while_a_turn_is_settled_is_a_lost_port(
    rig: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not a fault of the axis, which would stay after the port is back."""
    r = rig(fast_read="off")
    settle = turns.settle

    def pulled(client: ServoClient, axis: Axis) -> None:
        r.emulator.set("unplug")
        settle(client, axis)

    with monkeypatch.context() as patch:
        patch.setattr(turns, "settle", pulled)
        with pytest.raises(DeviceLostError):
            r.bus.open()
    r.emulator.set("replug")
    r.bus.open()
    r.bus.enable(BOTH)


@pytest.mark.realtime
def test_a_refused_register_is_a_fault_of_whole_words(rig: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    act = replies._act

    def refusing(packet: Any, servo: Servo) -> Any:
        if packet.instruction == 2 and packet.parameters[:2] == bytes((76, 0)):
            return 7, b""
        return act(packet, servo)

    monkeypatch.setattr(replies, "_act", refusing)
    r = rig(1)
    r.bus.open()
    fault = r.tick()["r.a1"].fault
    assert fault.startswith("reading register 76 was refused: not accessible")
    assert not fault.endswith(("; ", ";"))


def test_a_pending_hold_of_a_servo_whose_watchdog_tripped_ends(rig: Make) -> None:
    """A tripped watchdog refuses every goal until it is switched off."""
    r = running(rig)
    servo, axis = r.emulator.servo(1), r.bus._states["r.a1"]
    servo.memory[reg.BUS_WATCHDOG.address] = reg.WATCHDOG_TRIPPED
    axis.state, axis.watchdog_units = TorqueState.HOLD_PENDING, 0
    for _ in range(3):
        r.tick()
    assert axis.state is TorqueState.IDLE
    assert not servo.tripped
    assert servo.get(reg.GOAL_POSITION) == pytest.approx(servo.position_ticks, abs=2)
