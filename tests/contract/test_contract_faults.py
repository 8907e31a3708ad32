"""Faults: a failed read is never a number, a lost bus raises, a watchdog trips and stays tripped."""

from __future__ import annotations

import pytest

from contid.errors import DeviceError, DeviceLostError, DeviceNotFoundError
from contid.hal import Rest
from tests.contract.harness import offset

pytestmark = pytest.mark.process


def at(rig):
    return {axis: rig.value(axis) for axis in rig.bus.axes}


# -- one axis is silent ----------------------------------------------------------------------------------


def test_a_silent_axis_keeps_its_last_value_and_costs_no_other(enabled):
    first, *others = enabled.bus.axes
    good = enabled.pump(0.0)[first]
    enabled.silence(first, True)
    ages = []
    for _ in range(3):
        samples = enabled.pump(0.0, offset(enabled, others, 0.0))
        assert not samples[first].valid
        assert (samples[first].value, samples[first].time_s) == (good.value, good.time_s)
        assert all(samples[axis].valid for axis in others)
        ages.append(samples[first].age_s)
    assert ages == sorted(set(ages))
    assert ages[0] > 0.0
    enabled.silence(first, False)
    back = enabled.pump(0.0)[first]
    assert back.valid
    assert back.time_s > good.time_s


def test_the_others_move_while_one_is_silent(enabled):
    first, *others = enabled.bus.axes
    enabled.silence(first, True)
    goals = offset(enabled, others, enabled.facts.near)
    enabled.pump(enabled.facts.settle_s, goals)
    for axis, goal in goals.items():
        assert enabled.value(axis) == pytest.approx(goal, abs=enabled.facts.reading)


def test_enable_is_all_or_nothing(ready):
    first, *others = ready.bus.axes
    ready.silence(first, True)
    ready.pump(0.0)
    with pytest.raises(DeviceError, match=first):
        ready.bus.enable((*others, first))
    before = at(ready)
    ready.pump(ready.facts.settle_s, offset(ready, others, ready.facts.near))
    for axis in others:
        assert ready.value(axis) == pytest.approx(before[axis], abs=ready.facts.reading)


def test_open_names_the_axis_that_is_missing(rig):
    missing = rig.bus.axes[1]
    rig.silence(missing, True)
    with pytest.raises(DeviceNotFoundError, match=missing):
        rig.bus.open()
    rig.silence(missing, False)
    rig.bus.open()
    assert all(sample.valid for sample in rig.pump(0.0).values())


# -- the bus is gone -------------------------------------------------------------------------------------


def test_a_lost_bus_raises_at_once_and_until_it_is_opened_again(enabled):
    enabled.unplug()
    for _ in range(3):
        with pytest.raises(DeviceLostError):
            enabled.bus.exchange({})
    with pytest.raises(DeviceLostError):
        enabled.bus.enable(enabled.bus.axes)
    with pytest.raises(DeviceNotFoundError):
        enabled.bus.open()
    enabled.plug()
    with pytest.raises(DeviceLostError):
        enabled.bus.exchange({})
    enabled.bus.open()
    assert all(sample.valid for sample in enabled.pump(0.0).values())


def test_stopping_a_lost_bus_never_raises(enabled):
    enabled.unplug()
    enabled.bus.disable(enabled.bus.axes, Rest.RELAX)
    with pytest.raises(DeviceLostError):
        enabled.bus.exchange({})
    enabled.bus.disable(enabled.bus.axes, Rest.HOLD)
    enabled.bus.close()
    enabled.bus.close()
    enabled.plug()


def test_devices_of_a_lost_bus_come_to_rest_and_do_not_move_when_it_is_back(enabled):
    goals = offset(enabled, enabled.bus.axes, enabled.facts.far)
    enabled.pump(0.0, goals)
    enabled.unplug()
    with pytest.raises(DeviceLostError):
        enabled.bus.exchange(goals)
    enabled.wait(enabled.facts.watchdog_s + enabled.facts.settle_s + enabled.facts.vent_s)
    before = at(enabled)
    enabled.plug()
    enabled.bus.open()
    samples = enabled.pump(enabled.facts.settle_s, goals)
    for axis, value in before.items():
        assert value < goals[axis] - enabled.facts.near
        assert enabled.value(axis) == pytest.approx(value, abs=enabled.facts.still)
        assert samples[axis].fault != ""
    enabled.bus.clear_fault(enabled.bus.axes)
    enabled.bus.enable(enabled.bus.axes)
    near = offset(enabled, enabled.bus.axes, enabled.facts.near)
    enabled.pump(enabled.facts.settle_s, near)
    for axis, goal in near.items():
        assert enabled.value(axis) == pytest.approx(goal, abs=enabled.facts.reading)


# -- the watchdog ----------------------------------------------------------------------------------------


def let_watchdog_expire(rig):
    """Send every axis far away, then fall silent until all of them rest."""
    goals = offset(rig, rig.bus.axes, rig.facts.far)
    rig.pump(0.0, goals)
    rig.wait(rig.facts.watchdog_s + rig.facts.settle_s + rig.facts.vent_s)
    return goals


def test_the_watchdog_brings_devices_to_rest_by_itself(enabled):
    start = at(enabled)
    goals = let_watchdog_expire(enabled)
    rested = at(enabled)
    enabled.wait(enabled.facts.settle_s)
    for axis, value in rested.items():
        assert enabled.value(axis) == pytest.approx(value, abs=enabled.facts.still)
        assert value < goals[axis] - enabled.facts.near
        if enabled.facts.on_watchdog is Rest.VENT:
            assert value == pytest.approx(0.0, abs=enabled.facts.reading)
        else:
            assert value >= start[axis] - enabled.facts.still
        assert enabled.powered(axis) == (enabled.facts.on_watchdog is Rest.HOLD)


def test_a_trip_is_latched_and_clearing_it_never_moves(enabled):
    goals = let_watchdog_expire(enabled)
    rested = at(enabled)
    samples = enabled.pump(enabled.facts.settle_s, goals)
    for axis, value in rested.items():
        assert samples[axis].valid
        assert samples[axis].fault != ""
        assert enabled.value(axis) == pytest.approx(value, abs=enabled.facts.still)
    with pytest.raises(DeviceError):
        enabled.bus.enable(enabled.bus.axes)
    enabled.bus.clear_fault(enabled.bus.axes)
    samples = enabled.pump(enabled.facts.settle_s, goals)
    for axis, value in rested.items():
        assert samples[axis].fault == ""
        assert enabled.value(axis) == pytest.approx(value, abs=enabled.facts.still)
    enabled.bus.enable(enabled.bus.axes)
    near = offset(enabled, enabled.bus.axes, enabled.facts.near)
    enabled.pump(enabled.facts.settle_s, near)
    for axis, goal in near.items():
        assert enabled.value(axis) == pytest.approx(goal, abs=enabled.facts.reading)


def test_a_refused_tick_does_not_feed_the_watchdog(enabled):
    first = enabled.bus.axes[0]
    for _ in range(6):
        enabled.wait(enabled.facts.watchdog_s / 3)
        with pytest.raises(DeviceError):
            enabled.bus.exchange({first: float("nan")})
    assert enabled.pump(0.0)[first].fault != ""


def test_clearing_nothing_disturbs_nothing(enabled):
    goals = offset(enabled, enabled.bus.axes, enabled.facts.near)
    enabled.pump(0.0, goals)
    enabled.bus.clear_fault(enabled.bus.axes)
    enabled.pump(enabled.facts.settle_s, goals)
    for axis, goal in goals.items():
        assert enabled.value(axis) == pytest.approx(goal, abs=enabled.facts.reading)


# -- a device's own fault --------------------------------------------------------------------------------


def test_a_broken_device_reports_its_fault_and_the_others_go_on(enabled):
    first, *others = enabled.bus.axes
    enabled.break_device(first)
    goals = offset(enabled, enabled.bus.axes, enabled.facts.near)
    samples = enabled.pump(enabled.facts.settle_s, goals)
    assert samples[first].fault != ""
    assert not enabled.powered(first)
    for axis in others:
        assert samples[axis].fault == ""
        assert enabled.value(axis) == pytest.approx(goals[axis], abs=enabled.facts.reading)


def test_a_fault_that_persists_cannot_be_cleared(enabled):
    first = enabled.bus.axes[0]
    enabled.break_device(first)
    enabled.pump(enabled.facts.settle_s)
    with pytest.raises(DeviceError, match=first):
        enabled.bus.clear_fault([first])
    assert enabled.pump(0.0)[first].fault != ""
    with pytest.raises(DeviceError, match=first):
        enabled.bus.enable([first])


def test_a_repaired_device_stays_at_rest_until_it_is_cleared_and_enabled(enabled):
    first = enabled.bus.axes[0]
    enabled.break_device(first)
    enabled.pump(enabled.facts.settle_s + enabled.facts.vent_s)
    enabled.repair_device(first)
    before = enabled.value(first)
    goal = {first: before + enabled.facts.near}
    assert enabled.pump(enabled.facts.settle_s, goal)[first].fault != ""
    enabled.bus.clear_fault([first])
    assert enabled.pump(enabled.facts.settle_s, goal)[first].fault == ""
    assert enabled.value(first) == pytest.approx(before, abs=enabled.facts.still)
    enabled.bus.enable([first])
    enabled.pump(enabled.facts.settle_s, goal)
    assert enabled.value(first) == pytest.approx(goal[first], abs=enabled.facts.reading)
