"""The watchdog of the devices: trips without exchanges, and stays tripped."""

from __future__ import annotations

import pytest

from contid.errors import DeviceError
from contid.hal import Rest
from contid_driverkit.contract.rig import BusUnderTest, offset, values


class WatchdogContract:
    """What the devices must do when the host falls silent, or that they have no watchdog."""

    def test_without_exchanges_devices_do_what_they_declare(self, enabled: BusUnderTest) -> None:
        """A watchdog trips; devices without one obey as before after a silence of the host."""
        enabled.wait(enabled.facts.silence_s + enabled.facts.settle_s)
        faults = {axis: sample.fault for axis, sample in enabled.pump(0.0).items()}
        if enabled.facts.watchdog_s is not None:
            assert all("watchdog" in fault.lower() for fault in faults.values())
            return
        assert not any(faults.values())
        goals = offset(enabled, enabled.bus.axes, enabled.facts.near)
        enabled.pump(enabled.facts.settle_s, goals)
        assert values(enabled) == pytest.approx(goals, abs=enabled.facts.reading)

    def test_the_watchdog_brings_devices_to_rest_by_itself(self, enabled: BusUnderTest) -> None:
        start = values(enabled)
        goals = _let_watchdog_expire(enabled)
        rested = values(enabled)
        enabled.wait(enabled.facts.settle_s)
        for axis, value in rested.items():
            assert enabled.value(axis) == pytest.approx(value, abs=enabled.facts.still)
            assert value < goals[axis] - enabled.facts.near
            if enabled.facts.on_watchdog is Rest.VENT:
                assert value == pytest.approx(0.0, abs=enabled.facts.reading)
            else:
                assert value >= start[axis] - enabled.facts.still
            assert enabled.powered(axis) == (enabled.facts.on_watchdog is Rest.HOLD)

    def test_a_trip_is_latched_and_clearing_it_never_moves(self, enabled: BusUnderTest) -> None:
        goals = _let_watchdog_expire(enabled)
        rested = values(enabled)
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
        assert values(enabled) == pytest.approx(near, abs=enabled.facts.reading)

    def test_a_refused_tick_does_not_feed_the_watchdog(self, enabled: BusUnderTest) -> None:
        watchdog_s = _watchdog_s(enabled)
        first = enabled.bus.axes[0]
        for _ in range(6):
            enabled.wait(watchdog_s / 3)
            with pytest.raises(DeviceError):
                enabled.bus.exchange({first: float("nan")})
        assert enabled.pump(0.0)[first].fault != ""

    def test_clearing_nothing_disturbs_nothing(self, enabled: BusUnderTest) -> None:
        goals = offset(enabled, enabled.bus.axes, enabled.facts.near)
        enabled.pump(0.0, goals)
        enabled.bus.clear_fault(enabled.bus.axes)
        enabled.pump(enabled.facts.settle_s, goals)
        assert values(enabled) == pytest.approx(goals, abs=enabled.facts.reading)

    def test_reading_alone_feeds_the_watchdog(self, enabled: BusUnderTest) -> None:
        samples = enabled.pump(_watchdog_s(enabled) * 3)
        assert all(sample.fault == "" for sample in samples.values())
        assert all(enabled.powered(axis) for axis in enabled.bus.axes)


def _watchdog_s(rig: BusUnderTest) -> float:
    """The watchdog; the test is skipped for devices without one."""
    if rig.facts.watchdog_s is None:
        pytest.skip("its devices have no watchdog, as declared")
    return rig.facts.watchdog_s


def _let_watchdog_expire(rig: BusUnderTest) -> dict[str, float]:
    """Send every axis far away, then fall silent until all of them rest; the goals come back."""
    watchdog_s = _watchdog_s(rig)
    goals = offset(rig, rig.bus.axes, rig.facts.far)
    rig.pump(0.0, goals)
    rig.wait(watchdog_s + rig.facts.settle_s + rig.facts.vent_s)
    return goals
