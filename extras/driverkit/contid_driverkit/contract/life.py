"""Life cycle: opening never moves, enabling never jumps, rest states are kept, closing changes no torque.

Lengths of time and distances are those of `Facts`; ``pump(0.0)`` is one exchange.
"""

from __future__ import annotations

import pytest

from contid.errors import DeviceError
from contid.hal import Bus, DeviceKind, Rest
from contid_driverkit.contract.rig import BusUnderTest, offset, values


class LifeContract:
    """What a bus must do from its opening to its closing."""

    def test_is_a_bus(self, rig: BusUnderTest) -> None:
        assert isinstance(rig.bus, Bus)
        assert len(rig.bus.axes) >= 2
        assert len(set(rig.bus.axes)) == len(rig.bus.axes)

    def test_nothing_works_before_open(self, rig: BusUnderTest) -> None:
        with pytest.raises(DeviceError):
            rig.bus.exchange({})
        with pytest.raises(DeviceError):
            rig.bus.enable(rig.bus.axes)
        with pytest.raises(DeviceError):
            rig.bus.clear_fault(rig.bus.axes)

    def test_open_disable_close_in_any_state_and_twice(self, rig: BusUnderTest) -> None:
        rig.bus.close()
        rig.bus.disable(rig.bus.axes, Rest.RELAX)
        rig.bus.open()
        rig.bus.open()
        rig.pump(0.0)
        rig.bus.disable(rig.bus.axes, Rest.RELAX)
        rig.bus.disable(rig.bus.axes, Rest.RELAX)
        rig.bus.close()
        rig.bus.close()
        rig.bus.disable(rig.bus.axes, Rest.HOLD)
        with pytest.raises(DeviceError):
            rig.bus.exchange({})
        rig.bus.open()
        assert all(sample.valid for sample in rig.pump(0.0).values())

    def test_samples_before_enable(self, ready: BusUnderTest) -> None:
        samples = ready.pump(0.0)
        assert tuple(samples) == ready.bus.axes
        for axis, sample in samples.items():
            assert sample.valid
            assert sample.value == pytest.approx(ready.value(axis), abs=ready.facts.reading)
            assert sample.fault == ""

    def test_opening_and_reading_never_moves_nor_powers(self, rig: BusUnderTest) -> None:
        before = {axis: (rig.value(axis), rig.powered(axis)) for axis in rig.bus.axes}
        rig.bus.open()
        rig.pump(rig.facts.settle_s)
        for axis, (value, powered) in before.items():
            assert rig.value(axis) == pytest.approx(value, abs=rig.facts.still)
            assert rig.powered(axis) == powered

    def test_no_jump_at_enable(self, enabled: BusUnderTest) -> None:
        before = values(enabled)
        assert all(enabled.powered(axis) for axis in enabled.bus.axes)
        enabled.pump(enabled.facts.settle_s)
        # The goal is the reading rounded to a step of the device.
        assert values(enabled) == pytest.approx(before, abs=enabled.facts.reading)

    def test_no_jump_at_enable_after_the_device_was_sent_elsewhere(self, enabled: BusUnderTest) -> None:
        """The old goal is far away; enabling again must not make the device resume it."""
        enabled.pump(0.0, offset(enabled, enabled.bus.axes, enabled.facts.far))
        enabled.bus.disable(enabled.bus.axes, Rest.HOLD)
        enabled.pump(enabled.facts.settle_s)
        before = values(enabled)
        enabled.bus.enable(enabled.bus.axes)
        enabled.pump(enabled.facts.settle_s)
        assert values(enabled) == pytest.approx(before, abs=enabled.facts.reading)

    def test_enabling_twice_does_not_disturb_the_motion(self, enabled: BusUnderTest) -> None:
        goals = offset(enabled, enabled.bus.axes, enabled.facts.near)
        enabled.pump(0.0, goals)
        enabled.bus.enable(enabled.bus.axes)
        enabled.pump(enabled.facts.settle_s)
        assert values(enabled) == pytest.approx(goals, abs=enabled.facts.reading)

    def test_hold_stays_where_it_is(self, enabled: BusUnderTest) -> None:
        enabled.pump(0.0, offset(enabled, enabled.bus.axes, enabled.facts.far))
        enabled.bus.disable(enabled.bus.axes, Rest.HOLD)
        enabled.pump(enabled.facts.settle_s)
        before = values(enabled)
        samples = enabled.pump(enabled.facts.silence_s * 2)
        for axis, value in before.items():
            assert enabled.value(axis) == pytest.approx(value, abs=enabled.facts.still)
            assert enabled.powered(axis)
            assert samples[axis].fault == ""

    @pytest.mark.parametrize("rest", [Rest.RELAX, Rest.VENT])
    def test_relax_and_vent_take_the_force_away(self, enabled: BusUnderTest, rest: Rest) -> None:
        enabled.pump(enabled.facts.settle_s, offset(enabled, enabled.bus.axes, enabled.facts.near))
        before = values(enabled)
        enabled.bus.disable(enabled.bus.axes, rest)
        enabled.pump(enabled.facts.settle_s + enabled.facts.vent_s)
        for axis, value in before.items():
            assert not enabled.powered(axis)
            end = 0.0 if enabled.facts.kind is DeviceKind.REGULATOR else value
            assert enabled.value(axis) == pytest.approx(end, abs=enabled.facts.reading)

    def test_a_resting_axis_needs_no_feeding(self, enabled: BusUnderTest) -> None:
        enabled.bus.disable(enabled.bus.axes, Rest.HOLD)
        enabled.wait(enabled.facts.silence_s * 2)
        assert all(sample.fault == "" for sample in enabled.pump(0.0).values())

    def test_closing_and_opening_never_touch_torque(self, enabled: BusUnderTest) -> None:
        enabled.bus.close()
        assert all(enabled.powered(axis) for axis in enabled.bus.axes)
        enabled.bus.open()
        assert all(enabled.powered(axis) for axis in enabled.bus.axes)

    def test_axes_are_not_enabled_after_closing(self, enabled: BusUnderTest) -> None:
        axis = enabled.bus.axes[0]
        enabled.bus.close()
        enabled.bus.open()
        enabled.pump(0.0)
        before = enabled.value(axis)
        # For less than the silence that trips a watchdog: only a command that was carried out would move it.
        enabled.pump(enabled.facts.silence_s / 2, {axis: before + enabled.facts.near})
        assert enabled.value(axis) == pytest.approx(before, abs=enabled.facts.reading)
