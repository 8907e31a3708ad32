"""Every fault switch, the state the axis must be in, and within how many exchanges."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from contid.errors import DeviceError
from contid.hal import Rest
from contid_drivers.dynamixel import arming
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.client import ServoClient
from contid_drivers.dynamixel.packets import Instruction
from contid_emulate.dynamixel import InjectedFault, machine, replies
from tests.wire.dynamixel.conftest import servos

pytestmark = pytest.mark.realtime

TICK = reg.RAD_PER_TICK
Make = Callable[..., Any]
ALL = ["r.a1", "r.a2", "r.a3"]


@pytest.fixture(params=["auto", "off"], ids=["fast", "plain"])
def running(rig: Make, request: pytest.FixtureRequest) -> Any:
    """Three enabled servos, exchanging, with fast and with plain reads."""
    r = rig(3, fast_read=request.param)
    r.bus.open()
    r.bus.enable(ALL)
    r.tick(2)
    return r


@pytest.mark.parametrize("kind", ["drop", "corrupt"])
def test_a_lost_answer_is_requested_again_within_the_same_exchange(running: Any, kind: str) -> None:
    # A fast read has one answer for all, under the broadcast id.
    running.emulator.set(kind, 254 if running.options.fast_read == "auto" else 2, count=1)
    samples = running.tick()
    assert all(sample.valid for sample in samples.values())


@pytest.mark.parametrize("kind", ["drop", "corrupt"])
def test_without_a_retry_a_lost_answer_is_an_invalid_sample_of_that_axis_only(rig: Make, kind: str) -> None:
    r = rig(3, fast_read="off", retry_ms=0)
    r.bus.open()
    before = r.tick()
    r.emulator.set(kind, 2, count=1)
    samples = r.tick()
    assert [sample.valid for sample in samples.values()] == [True, False, True]
    assert samples["r.a2"].value == before["r.a2"].value
    assert samples["r.a2"].age_s > 0
    assert all(sample.valid for sample in r.tick().values())


def test_a_duplicated_answer_changes_nothing(running: Any) -> None:
    for device in (1, 2, 3, 254):
        running.emulator.set("duplicate", device)
    for _ in range(3):
        samples = running.tick()
        assert [s.value for s in samples.values()] == pytest.approx([1000 * TICK, 2000 * TICK, 3000 * TICK])
        assert all(s.valid for s in samples.values())


def test_an_echoing_adapter_changes_nothing(running: Any) -> None:
    running.emulator.set("echo")
    for _ in range(3):
        assert all(s.valid for s in running.tick().values())
    running.bus.disable(ALL, Rest.RELAX)
    assert not any(servo.torque for servo in running.emulator.servos)


def test_a_silent_servo_is_invalid_at_once_and_the_others_stay_valid(running: Any) -> None:
    running.emulator.set("silent", 2)
    for _ in range(4):
        assert [s.valid for s in running.tick().values()] == [True, False, True]
    running.emulator.set("silent", 2, on=False)
    assert all(s.valid for s in running.tick().values())


def test_a_servo_that_was_to_relax_does_so_also_when_it_returns_with_a_fault(rig: Make) -> None:
    """A supply that is too low need not switch the torque off (Shutdown, register 63)."""
    made = servos(2)
    made[1].put(reg.SHUTDOWN, 0x34)
    r = rig(2, made=made, usb_latency_ms=10.0)
    r.bus.open()
    r.bus.enable(r.bus.axes)
    r.tick(2)
    r.emulator.set("silent", 2)
    r.tick(3)
    r.bus.disable(r.bus.axes, Rest.RELAX)
    assert r.emulator.servo(2).torque
    r.emulator.set("alert", 2, bits=0x01)
    r.emulator.set("silent", 2, on=False)
    r.tick(4)
    assert not r.emulator.servo(2).torque


def test_a_servo_that_is_silent_while_enable_is_undone_relaxes_when_it_returns(
    rig: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    r = rig(2, usb_latency_ms=10.0)
    r.bus.open()
    arm = arming.arm

    def arm_the_first(client: ServoClient, axis: Axis) -> None:
        if axis.device == 2:
            r.emulator.set("silent", 1)
            raise DeviceError("r.a2", "torque does not come on")
        arm(client, axis)

    monkeypatch.setattr(arming, "arm", arm_the_first)
    with pytest.raises(DeviceError, match="does not come on"):
        r.bus.enable(r.bus.axes)
    assert r.emulator.servo(1).torque
    r.emulator.set("silent", 1, on=False)
    r.tick(4)
    assert not r.emulator.servo(1).torque


def test_axes_that_were_held_are_held_again_also_beside_a_silent_one(
    rig: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hold lasts without anybody: the watchdog of a failed enable is off again."""
    r = rig(2, usb_latency_ms=10.0)
    r.bus.open()
    r.bus.enable(r.bus.axes)
    r.bus.disable(r.bus.axes, Rest.HOLD)
    start = arming.start_watchdogs

    def start_and_lose_one(client: ServoClient, axes: list[Axis], watchdog: int) -> None:
        start(client, axes, watchdog)
        time.sleep(0.02)
        r.emulator.set("silent", 1)

    monkeypatch.setattr(arming, "start_watchdogs", start_and_lose_one)
    with pytest.raises(DeviceError, match="no answer"):
        r.bus.enable(r.bus.axes)
    assert r.emulator.servo(2).torque
    assert r.emulator.servo(2).get(reg.BUS_WATCHDOG) == 0


def test_a_late_answer_is_a_miss_and_never_taken_for_the_next_one(rig: Make) -> None:
    r = rig(2, fast_read="off", usb_latency_ms=5.0, retry_ms=0)
    r.bus.open()
    r.tick()
    r.emulator.set("delay", 2, ms=60)
    samples = [r.tick()["r.a2"] for _ in range(3)]
    assert not any(sample.valid for sample in samples)
    r.emulator.set("delay", 2, ms=0)
    time.sleep(0.1)
    r.until(lambda: r.tick()["r.a2"].valid)


def test_a_stale_answer_is_not_taken_for_the_answer_to_another_request(rig: Make) -> None:
    r = rig(1)
    r.bus.open()
    client = r.opened.client
    # The acknowledgement of this write arrives after its time-out, during the next request.
    r.emulator.set("delay", 1, ms=45)
    client.port.latency_s = 0.0
    assert client._ask(1, Instruction.WRITE, b"\x41\0\1", 0, tries=1) is None
    r.emulator.set("delay", 1, ms=0)
    assert client.ping(1) == 1200
    assert client.read(1, reg.TORQUE_ENABLE) == 0
    assert client.read(1, reg.PRESENT_VOLTAGE) == 50


@pytest.mark.process
@pytest.mark.parametrize(
    ("kind", "bits", "message"),
    [
        ("alert", {"bits": 0x04}, "overheated"),
        ("alert", {"bits": 0x01}, "input voltage"),
        ("overload", {}, "overload"),
    ],
)
def test_a_hardware_error_is_a_fault_with_text_within_one_exchange(
    running: Any, kind: str, bits: dict[str, int], message: str
) -> None:
    running.emulator.set(kind, 2, **bits)
    samples = running.tick(a1=1100 * TICK, a2=2100 * TICK)
    assert message in samples["r.a2"].fault
    assert samples["r.a2"].valid
    assert samples["r.a1"].fault == samples["r.a3"].fault == ""
    before = running.emulator.servo(2).position_ticks
    running.tick(5, a1=1100 * TICK, a2=2500 * TICK)
    running.until(lambda: abs(running.emulator.servo(1).position_ticks - 1100) < 1)
    assert running.emulator.servo(2).position_ticks == before
    with pytest.raises(DeviceError, match=message):
        running.bus.enable(["r.a2"])
    running.bus.clear_fault(["r.a2"])
    assert running.tick()["r.a2"].fault == ""
    assert not running.emulator.servo(2).torque
    running.bus.enable(["r.a2"])
    running.tick(3)
    assert running.emulator.servo(2).position_ticks == before


def test_torque_switched_off_from_outside_is_a_fault_and_returns_without_a_jump(
    running: Any,
) -> None:
    running.tick(3, a1=1100 * TICK, a2=2100 * TICK)
    running.opened.client.write(2, reg.TORQUE_ENABLE, 0)
    samples = running.tick(a1=1100 * TICK, a2=2500 * TICK)
    assert "switched off from outside" in samples["r.a2"].fault
    assert samples["r.a1"].fault == ""
    running.bus.clear_fault(["r.a2"])
    limp = running.emulator.servo(2).position_ticks
    assert not running.emulator.servo(2).torque
    running.bus.enable(["r.a2"])
    running.tick(5)
    assert abs(running.emulator.servo(2).position_ticks - limp) < 1


@pytest.mark.process
def test_a_tripped_watchdog_is_a_latched_fault_and_comes_back_without_a_jump(running: Any) -> None:
    running.tick(a1=9000 * TICK)
    running.tick(3)
    running.emulator.set("trip", 1)
    stopped = running.emulator.servo(1).position_ticks
    assert "Bus Watchdog tripped" in running.tick(a1=9000 * TICK)["r.a1"].fault
    running.tick(20, a1=9000 * TICK)
    assert running.emulator.servo(1).position_ticks == stopped
    running.bus.clear_fault(["r.a1"])
    running.bus.enable(["r.a1"])
    running.tick(10)
    assert abs(running.emulator.servo(1).position_ticks - stopped) < 1
    running.tick(a1=stopped * TICK + 100 * TICK)
    running.until(lambda: abs(running.emulator.servo(1).position_ticks - stopped - 100) < 1)


def test_the_watchdog_stops_a_servo_without_exchanges(rig: Make) -> None:
    r = rig(2, watchdog_ms=60)
    r.bus.open()
    r.bus.enable(["r.a1", "r.a2"])
    r.bus.exchange({"r.a1": 100000 * TICK, "r.a2": 100000 * TICK})
    time.sleep(0.3)
    stopped = [r.emulator.servo(i).position_ticks for i in (1, 2)]
    assert all(r.emulator.servo(i).tripped for i in (1, 2))
    time.sleep(0.05)
    assert [r.emulator.servo(i).position_ticks for i in (1, 2)] == stopped
    # 60 ms and a poll of the emulator at 103 rpm; far from the goal.
    assert max(stopped) < 5000


@pytest.mark.parametrize("armed", [True, False])
def test_a_brown_out_is_a_fault_within_two_exchanges_and_never_a_wrong_position(
    rig: Make, armed: bool
) -> None:
    r = rig(2, made=None, servo={"position_ticks": 3 * 4096 + 500.0}, axis={"homing": None})
    r.bus.open()
    if armed:
        r.bus.enable(["r.a1", "r.a2"])
    known = r.tick()["r.a1"].value
    r.emulator.set("brownout", 1)
    deadline = time.monotonic() + 5
    while not (sample := r.tick()["r.a1"]).fault:
        assert not sample.valid
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert "reset itself" in sample.fault
    assert not sample.valid
    assert sample.value == known
    with pytest.raises(DeviceError):
        r.bus.enable(["r.a1"])
    r.bus.clear_fault(["r.a1"])
    # The count is gone, the shaft is where it was: the turn is taken from where it was last seen.
    assert r.tick()["r.a1"].value == pytest.approx(known)
    r.bus.enable(["r.a1"])
    before = r.emulator.servo(1).position_ticks
    r.tick(a1=known + 50 * TICK)
    r.until(lambda: abs(r.emulator.servo(1).position_ticks - before - 50) < 1)


def test_a_servo_that_moved_while_it_was_reset_has_to_be_homed(rig: Make) -> None:
    r = rig(1)
    r.bus.open()
    r.tick()
    r.emulator.set("brownout", 1)
    r.emulator.servo(1).motion.position += 1500
    r.until(lambda: r.tick()["r.a1"].fault != "")
    with pytest.raises(DeviceError, match="contid home"):
        r.bus.clear_fault(["r.a1"])


def test_the_control_file_operates_the_same_switches(rig: Make, tmp_path: Path) -> None:
    r = rig(2, retry_ms=0)
    r.bus.open()
    with (tmp_path / "faults.jsonl").open("a") as file:
        file.write(json.dumps({"fault": "overload", "id": 2}) + "\n" + '{"fault": "nonsense"}\n')
    r.until(lambda: "overload" in r.tick()["r.a2"].fault)
    errors = tmp_path / "faults.jsonl.errors"
    r.until(lambda: errors.exists() and "nonsense" in errors.read_text())


def test_a_mistake_in_the_control_file_does_not_end_the_emulator(rig: Make, tmp_path: Path) -> None:
    r = rig(1)
    r.bus.open()
    with (tmp_path / "faults.jsonl").open("a") as file:
        file.write('{"fault": "chunks", "count": "seven"}\n{"fault": "drop", "id": [1]}\n')
    errors = tmp_path / "faults.jsonl.errors"
    r.until(lambda: errors.exists() and errors.read_text().count("\n") == 2)
    assert "count: Input should be a valid integer" in errors.read_text()
    assert r.tick()["r.a1"].valid


@pytest.mark.parametrize(
    "line", ["{", "[]", '{"fault": "drop"}', '{"fault": "echo", "id": 1}', '{"fault": "melt"}']
)
def test_wrong_fault_switches_are_refused(line: str) -> None:
    with pytest.raises(ValidationError):
        InjectedFault.model_validate_json(line)


def test_the_reboot_of_a_servo_trips_no_watchdog_of_the_others(
    rig: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes longer than they wait for an instruction."""
    monkeypatch.setattr(machine, "BOOT_S", 1.2)
    r = rig(3, watchdog_ms=500, usb_latency_ms=10)
    r.bus.open()
    r.bus.enable(r.bus.axes)
    r.emulator.set("overload", 2)
    r.until(lambda: "overload" in r.tick()["r.a2"].fault)
    r.bus.clear_fault(["r.a2"])
    assert [sample.fault for sample in r.tick().values()] == ["", "", ""]


def test_clear_fault_of_a_dead_servo_does_not_freeze_its_neighbours(running: Any) -> None:
    running.emulator.set("silent", 2)
    running.until(lambda: bool(running.bus._states["r.a2"].misses > 3))
    before = time.monotonic()
    running.bus.disable(["r.a2"], Rest.RELAX)
    with pytest.raises(DeviceError, match=r"r\.a2.*no answer"):
        running.bus.clear_fault(["r.a2"])
    # One time-out alone takes 40 ms here.
    assert time.monotonic() - before < 0.02
    running.emulator.set("silent", 2, on=False)
    running.until(lambda: running.tick()["r.a2"].valid)
    running.bus.clear_fault(["r.a2"])
    assert not running.emulator.servo(2).torque


def test_servos_behind_a_dead_one_are_found(rig: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    """A servo that waits for the answer of the one before it stays silent in a sync read."""
    r = rig(4, fast_read="off")
    r.bus.open()
    r.bus.enable(["r.a1", "r.a2", "r.a3", "r.a4"])
    r.tick(3)
    reads = replies._reads

    def chained(instruction: int, blocks: list[Any], servos: Any, byte_s: float) -> list[Any]:
        ids = [servo.device for servo in servos]
        alive = list(itertools.takewhile(lambda block: block.device in ids, blocks))
        return reads(instruction, alive, servos, byte_s)

    monkeypatch.setattr(replies, "_reads", chained)
    for dead in ((1,), (2, 3), (3,), (1, 4)):
        for device in dead:
            r.emulator.set("silent", device)
        r.tick(20)
        samples = r.tick(3)
        valid = [samples[f"r.a{i}"].valid for i in (1, 2, 3, 4)]
        assert valid == [i not in dead for i in (1, 2, 3, 4)], f"dead: {dead}"
        for device in dead:
            r.emulator.set("silent", device, on=False)
        r.until(lambda: all(sample.valid for sample in r.tick().values()))
