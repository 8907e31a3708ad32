"""A bus on the kit over devices that lose orders, answers and power; its contract is in tests/contract."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import pytest
from pydantic import BaseModel

from contid.control.engine.cycle import VirtualClock
from contid.errors import DeviceError, DeviceLostError, DeviceNotFoundError
from contid.hal import AxisOnBus, Rest
from contid_driverkit import PolledBus, Reading, examine_bus, polled_bus


@dataclass
class Device:
    """A device that goes to its goal at once while it has power."""

    value: float = 1.0
    goal: float = 9.0
    powered: bool = False
    fault: str = ""
    silent: bool = False
    deaf: int = 0  # orders that are lost before one arrives
    reports: bool = True  # its goal
    lost_power: bool = False  # power that is switched on drops out again

    def receives(self) -> bool:
        self.deaf -= 1
        return self.deaf < 0

    def settle(self) -> None:
        self.powered = self.powered and not self.lost_power
        if self.powered:
            self.value = self.goal


class NoKeys(BaseModel):
    pass


class ScriptedBus(PolledBus):
    """Devices by axis, and a log of what was sent."""

    def __init__(self, *names: str) -> None:
        self.clock = VirtualClock(1.0)
        self.devices = {name: Device() for name in names}
        self.sent: list[str] = []
        self.gone = self.missing = False
        super().__init__("bus", [AxisOnBus(name, NoKeys()) for name in names], self.clock)

    def connect(self) -> None:
        if self.missing:
            raise DeviceNotFoundError(self.name, "no answer from b")

    def disconnect(self) -> None:
        self.sent.append("closed")

    def read(self) -> Mapping[str, Reading]:
        self.clock.sleep(0.001)
        if self.gone:
            raise DeviceLostError(self.name, "unplugged")
        for device in self.devices.values():
            device.settle()
        return {
            name: Reading(each.value, each.powered, each.fault, each.goal if each.reports else None)
            for name, each in self.devices.items()
            if not each.silent
        }

    def send(self, goals: Mapping[str, float]) -> None:
        self.sent.append(f"goals {dict(goals)}")
        for name, goal in goals.items():
            if self.devices[name].receives():
                self.devices[name].goal = goal

    def power(self, axes: Collection[str], on: bool) -> None:
        self.sent.append(f"power {sorted(axes)} {on}")
        for name in axes:
            if self.devices[name].receives():
                self.devices[name].powered = on


@pytest.fixture
def bus() -> ScriptedBus:
    made = ScriptedBus("a", "b")
    made.open()
    made.sent.clear()
    return made


def test_the_goal_is_sent_before_the_power(bus: ScriptedBus) -> None:
    bus.enable(["a"])
    assert bus.sent == ["goals {'a': 1.0}", "power ['a'] True"]
    assert bus.devices["a"].value == 1.0  # and not the 9.0 that another program left


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_lost_orders_are_repeated_and_power_waits_for_the_goal(bus: ScriptedBus, lost: int) -> None:
    bus.devices["a"].deaf = lost
    bus.enable(["a"])
    assert bus.devices["a"].powered
    assert bus.devices["a"].value == 1.0


def test_a_device_that_never_takes_its_goal_gets_no_power(bus: ScriptedBus) -> None:
    bus.devices["a"].deaf = 100
    with pytest.raises(DeviceError, match="does not take its goal"):
        bus.enable(["a"])
    assert not any("True" in each for each in bus.sent)


def test_a_device_that_reports_no_goal_is_powered_after_one_was_sent(bus: ScriptedBus) -> None:
    bus.devices["a"].reports = False
    bus.enable(["a"])
    assert bus.sent == ["goals {'a': 1.0}", "power ['a'] True"]
    bus.disable(["a"], Rest.HOLD)
    assert len(bus.sent) == 2 + 6  # repeated, because nothing confirms it


@pytest.mark.parametrize("silent", [False, True])
def test_a_hold_that_is_not_confirmed_is_named(
    bus: ScriptedBus, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, silent: bool
) -> None:
    bus.enable(bus.axes)
    a = bus.devices["a"]
    monkeypatch.setattr(a, "settle", lambda: None)  # it is on its way
    a.deaf, a.silent, a.goal = 100, silent, 3.0
    bus.disable(bus.axes, Rest.HOLD)
    assert [record.getMessage() for record in caplog.records] == ["bus: hold is not confirmed by a"]


def test_an_axis_whose_first_answers_are_lost_is_held_too(
    bus: ScriptedBus, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    bus.enable(bus.axes)
    a, lost = bus.devices["a"], iter([True, True, True])

    def on_its_way() -> None:
        a.silent = next(lost, False)

    monkeypatch.setattr(a, "settle", on_its_way)
    a.goal = 3.0
    bus.disable(bus.axes, Rest.HOLD)
    assert a.goal == a.value == 1.0
    assert not caplog.records


def test_power_that_does_not_come_is_an_error_and_costs_the_holding_axis_nothing(bus: ScriptedBus) -> None:
    bus.devices["b"].powered, bus.devices["b"].goal = True, 1.0  # holds a weight
    bus.devices["a"].lost_power = True
    with pytest.raises(DeviceError, match="power does not switch on"):
        bus.enable(["a", "b"])
    assert bus.devices["b"].powered
    assert bus.sent[-1] == "power ['a'] False"
    bus.exchange({"b": 5.0})
    assert bus.devices["b"].value == 1.0  # all or nothing


def test_power_off_is_repeated_also_to_a_silent_device_and_named_when_not_confirmed(
    bus: ScriptedBus, caplog: pytest.LogCaptureFixture
) -> None:
    bus.enable(bus.axes)
    bus.devices["a"].silent, bus.devices["a"].deaf = True, 2
    with caplog.at_level(logging.WARNING):
        bus.disable(bus.axes, Rest.RELAX)
    assert not bus.devices["a"].powered
    assert not bus.devices["b"].powered
    assert "power off is not confirmed by a" in caplog.text


@pytest.mark.parametrize("rest", [Rest.RELAX, Rest.HOLD])
@pytest.mark.parametrize("reports", [True, False])
def test_a_rest_that_a_silent_device_missed_is_sent_when_it_answers(
    bus: ScriptedBus, rest: Rest, reports: bool
) -> None:
    bus.enable(["a"])
    device = bus.devices["a"]
    device.reports = reports
    bus.exchange({"a": 3.0})
    device.silent, device.deaf, device.goal = True, 99, 7.0
    bus.disable(["a"], rest)
    device.silent, device.deaf = False, 0
    for _ in range(3):
        bus.exchange({})
    assert device.powered is (rest is Rest.HOLD)
    at, sent = device.value, len(bus.sent)
    bus.exchange({})
    assert (device.goal, len(bus.sent)) == (at, sent)


def test_a_rest_asked_for_while_the_bus_is_lost_is_sent_when_it_is_back(bus: ScriptedBus) -> None:
    bus.enable(["a"])
    bus.gone = True
    with pytest.raises(DeviceLostError):
        bus.exchange({})
    bus.disable(["a"], Rest.RELAX)
    bus.gone = False
    bus.open()
    bus.exchange({})
    bus.exchange({})
    assert not bus.devices["a"].powered


@pytest.mark.parametrize("lost", [False, True])
def test_a_pending_hold_takes_the_place_where_the_device_answers_again(bus: ScriptedBus, lost: bool) -> None:
    """It may have been moved meanwhile: a goal that was read before would make it jump back."""
    device = bus.devices["a"]
    bus._asked["a"] = polled_bus._AskedRest(Rest.HOLD, 3.0)
    device.silent = bus.gone = True
    if lost:
        with pytest.raises(DeviceLostError):
            bus.exchange({})
    bus.gone = False
    if lost:
        bus.open()
    bus.exchange({})
    device.silent, device.powered = False, True
    device.value = device.goal = 50.0
    bus.sent.clear()
    bus.exchange({})
    bus.exchange({})
    assert "goals {'a': 3.0}" not in bus.sent
    assert device.value == 50.0


def test_hold_keeps_one_place_whatever_is_repeated(bus: ScriptedBus) -> None:
    bus.enable(bus.axes)
    bus.devices["a"].goal = bus.devices["a"].value = 4.0
    bus.disable(["a"], Rest.HOLD)
    assert set(bus.sent[2:]) == {"goals {'a': 4.0}"}
    assert bus.devices["a"].powered


def test_a_reset_device_is_a_latched_fault_and_gets_no_further_goal(bus: ScriptedBus) -> None:
    bus.enable(bus.axes)
    bus.devices["a"].powered = False
    assert "torque lost" in bus.exchange({"a": 2.0})["a"].fault
    bus.sent.clear()
    bus.exchange({"a": 3.0, "b": 3.0})
    assert bus.sent == ["goals {'b': 3.0}"]
    bus.clear_fault(["a"])
    assert bus.exchange({})["a"].fault == ""


def test_a_faulty_device_is_switched_off_until_it_confirms(bus: ScriptedBus) -> None:
    bus.enable(bus.axes)
    bus.devices["a"].fault, bus.devices["a"].deaf = "overload", 1
    for _ in range(3):
        bus.exchange({})
    assert bus.sent[2:] == ["power ['a'] False"] * 2
    with pytest.raises(DeviceError, match="overload"):
        bus.clear_fault(["a"])
    with pytest.raises(DeviceError, match="no such axis on bus bus; there are a, b"):
        bus.enable(["c"])


def test_a_lost_bus_and_one_that_does_not_open_are_closed(bus: ScriptedBus) -> None:
    bus.gone = True
    with pytest.raises(DeviceLostError, match="unplugged"):
        bus.exchange({})
    assert bus.sent == ["closed"]
    bus.gone, bus.missing = False, True
    with pytest.raises(DeviceLostError, match="unplugged"):
        bus.exchange({})
    with pytest.raises(DeviceNotFoundError):
        bus.open()
    with pytest.raises(DeviceLostError):
        bus.exchange({})


def test_doctor_counts_the_answers_and_names_faults(bus: ScriptedBus, tmp_path) -> None:
    port = tmp_path / "port"
    port.touch()
    bus.devices["a"].fault, bus.devices["b"].silent = "overheating", True
    *_, first, second = examine_bus(bus, str(port))
    assert (first.ok, second.ok) == (False, False)
    assert "50 of 50 answers, reads 1.0000, overheating" in first.message
    assert "0 of 50 answers" in second.message
    (missing,) = examine_bus(bus, str(tmp_path / "none"))
    assert not missing.ok
    assert "no port" in missing.message
