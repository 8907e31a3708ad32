"""Faults: a failed read is never a number, a lost bus raises, a broken device rests."""

from __future__ import annotations

from contextlib import suppress

import pytest

from contid.errors import DeviceError, DeviceLostError, DeviceNotFoundError
from contid.hal import Rest
from contid_driverkit.contract.rig import BusUnderTest, offset, values


class FaultContract:
    """What a bus must do when devices are silent, broken or gone."""

    def test_a_silent_axis_keeps_its_last_value_and_costs_no_other(self, enabled: BusUnderTest) -> None:
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

    def test_the_others_move_while_one_is_silent(self, enabled: BusUnderTest) -> None:
        first, *others = enabled.bus.axes
        enabled.silence(first, True)
        goals = offset(enabled, others, enabled.facts.near)
        enabled.pump(enabled.facts.settle_s, goals)
        assert values(enabled, goals) == pytest.approx(goals, abs=enabled.facts.reading)

    def test_enable_is_all_or_nothing(self, ready: BusUnderTest) -> None:
        first, *others = ready.bus.axes
        ready.silence(first, True)
        ready.pump(0.0)
        with pytest.raises(DeviceError, match=first):
            ready.bus.enable((*others, first))
        before = values(ready)
        ready.pump(ready.facts.settle_s, offset(ready, others, ready.facts.near))
        for axis in others:
            assert ready.value(axis) == pytest.approx(before[axis], abs=ready.facts.reading)

    def test_open_names_the_axis_that_is_missing(self, rig: BusUnderTest) -> None:
        missing = rig.bus.axes[1]
        rig.silence(missing, True)
        with pytest.raises(DeviceNotFoundError, match=missing):
            rig.bus.open()
        rig.silence(missing, False)
        rig.bus.open()
        assert all(sample.valid for sample in rig.pump(0.0).values())

    def test_a_lost_bus_raises_at_once_and_until_it_is_opened_again(self, enabled: BusUnderTest) -> None:
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

    def test_stopping_a_lost_bus_never_raises(self, enabled: BusUnderTest) -> None:
        enabled.unplug()
        enabled.bus.disable(enabled.bus.axes, Rest.RELAX)
        with pytest.raises(DeviceLostError):
            enabled.bus.exchange({})
        enabled.bus.disable(enabled.bus.axes, Rest.HOLD)
        enabled.bus.close()
        enabled.bus.close()
        enabled.plug()

    def test_a_relax_asked_for_while_the_bus_is_lost_is_done_when_it_is_back(
        self, enabled: BusUnderTest
    ) -> None:
        enabled.unplug()
        with pytest.raises(DeviceLostError):
            enabled.bus.exchange({})
        enabled.bus.disable(enabled.bus.axes, Rest.RELAX)
        enabled.plug()
        enabled.bus.open()
        enabled.pump(enabled.facts.settle_s + enabled.facts.vent_s)
        assert not any(enabled.powered(axis) for axis in enabled.bus.axes)

    def test_a_relax_that_a_silent_axis_missed_is_done_when_it_answers(self, enabled: BusUnderTest) -> None:
        """Whatever is asked of the bus meanwhile; it may be refused."""
        first = enabled.bus.axes[0]
        enabled.silence(first, True)
        enabled.bus.disable((first,), Rest.RELAX)
        enabled.pump(0.0)
        enabled.silence(first, False)
        with suppress(DeviceError):
            enabled.bus.clear_fault((first,))
        enabled.pump(enabled.facts.settle_s + enabled.facts.vent_s)
        assert not enabled.powered(first)

    def test_devices_of_a_lost_bus_rest_and_do_not_move_when_it_is_back(self, enabled: BusUnderTest) -> None:
        goals = offset(enabled, enabled.bus.axes, enabled.facts.far)
        enabled.pump(0.0, goals)
        enabled.unplug()
        with pytest.raises(DeviceLostError):
            enabled.bus.exchange(goals)
        enabled.wait(enabled.facts.silence_s + enabled.facts.settle_s + enabled.facts.vent_s)
        if watched := enabled.facts.watchdog_s is not None:
            before = values(enabled)
        enabled.plug()
        enabled.bus.open()
        if not watched:  # they go on until a host stops them
            enabled.bus.disable(enabled.bus.axes, Rest.HOLD)
            enabled.pump(enabled.facts.settle_s)
            before = values(enabled)
        samples = enabled.pump(enabled.facts.settle_s, goals)
        for axis, value in before.items():
            assert value < goals[axis] - enabled.facts.near
            assert enabled.value(axis) == pytest.approx(value, abs=enabled.facts.still)
            assert (samples[axis].fault != "") == watched
        enabled.bus.clear_fault(enabled.bus.axes)
        enabled.bus.enable(enabled.bus.axes)
        near = offset(enabled, enabled.bus.axes, enabled.facts.near)
        enabled.pump(enabled.facts.settle_s, near)
        assert values(enabled) == pytest.approx(near, abs=enabled.facts.reading)

    def test_a_broken_device_reports_its_fault_and_the_others_go_on(self, enabled: BusUnderTest) -> None:
        first, *others = enabled.bus.axes
        enabled.break_device(first)
        goals = offset(enabled, enabled.bus.axes, enabled.facts.near)
        samples = enabled.pump(enabled.facts.settle_s, goals)
        assert samples[first].fault != ""
        assert not enabled.powered(first)
        for axis in others:
            assert samples[axis].fault == ""
            assert enabled.value(axis) == pytest.approx(goals[axis], abs=enabled.facts.reading)

    def test_a_fault_that_persists_cannot_be_cleared(self, enabled: BusUnderTest) -> None:
        first = enabled.bus.axes[0]
        enabled.break_device(first)
        enabled.pump(enabled.facts.settle_s)
        with pytest.raises(DeviceError, match=first):
            enabled.bus.clear_fault([first])
        assert enabled.pump(0.0)[first].fault != ""
        with pytest.raises(DeviceError, match=first):
            enabled.bus.enable([first])

    def test_a_repaired_device_stays_at_rest_until_it_is_cleared_and_enabled(
        self, enabled: BusUnderTest
    ) -> None:
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
