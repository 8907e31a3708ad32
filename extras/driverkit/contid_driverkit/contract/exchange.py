"""The exchange of a tick: which axes move, which do not, and what holds of samples."""

from __future__ import annotations

import math

import pytest

from contid.errors import DeviceError
from contid.hal import Rest
from contid_driverkit.contract.rig import BusUnderTest, offset, values


class ExchangeContract:
    """What `contid.hal.Bus.exchange` must do; a rig (`BusUnderTest`) has two axes or more."""

    def test_commands_arrive(self, enabled: BusUnderTest) -> None:
        goals = offset(enabled, enabled.bus.axes, enabled.facts.near)
        samples = enabled.pump(enabled.facts.settle_s, goals)
        for axis, goal in goals.items():
            assert enabled.value(axis) == pytest.approx(goal, abs=enabled.facts.reading)
            assert samples[axis].value == pytest.approx(goal, abs=2 * enabled.facts.reading)

    def test_an_axis_left_out_keeps_its_goal(self, enabled: BusUnderTest) -> None:
        first, *others = enabled.bus.axes
        goal = offset(enabled, [first], enabled.facts.near)
        before = values(enabled, others)
        enabled.pump(0.0, goal)
        enabled.pump(enabled.facts.settle_s)
        assert enabled.value(first) == pytest.approx(goal[first], abs=enabled.facts.reading)
        assert values(enabled, before) == pytest.approx(before, abs=enabled.facts.reading)

    def test_the_order_of_commands_does_not_matter(self, enabled: BusUnderTest) -> None:
        goals = offset(enabled, enabled.bus.axes, enabled.facts.near)
        backwards = dict(reversed([*goals.items()]))
        assert tuple(enabled.pump(enabled.facts.settle_s, backwards)) == enabled.bus.axes
        assert values(enabled) == pytest.approx(goals, abs=enabled.facts.reading)

    def test_a_command_to_a_resting_axis_is_dropped_and_costs_no_other(self, ready: BusUnderTest) -> None:
        first, *others = ready.bus.axes
        ready.bus.enable(others)
        before = ready.value(first)
        goals = offset(ready, ready.bus.axes, ready.facts.near)
        ready.pump(ready.facts.settle_s, goals)
        assert ready.value(first) == pytest.approx(before, abs=ready.facts.still)
        for axis in others:
            assert ready.value(axis) == pytest.approx(goals[axis], abs=ready.facts.reading)
        # Nor is it kept for later: enabling does not make the axis go there.
        ready.bus.enable([first])
        ready.pump(ready.facts.settle_s)
        assert ready.value(first) == pytest.approx(before, abs=ready.facts.reading)

    def test_a_disabled_axis_obeys_no_longer(self, enabled: BusUnderTest) -> None:
        first = enabled.bus.axes[0]
        enabled.bus.disable([first], Rest.HOLD)
        enabled.pump(enabled.facts.settle_s)
        before = enabled.value(first)
        enabled.pump(enabled.facts.settle_s, {first: before + enabled.facts.near})
        assert enabled.value(first) == pytest.approx(before, abs=enabled.facts.reading)

    @pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
    def test_a_command_that_is_not_finite_stops_the_whole_tick(
        self, enabled: BusUnderTest, bad: float
    ) -> None:
        first, second = enabled.bus.axes[:2]
        before = enabled.value(first)
        with pytest.raises(DeviceError, match=second):
            enabled.bus.exchange({first: before + enabled.facts.near, second: bad})
        enabled.pump(enabled.facts.settle_s)
        assert enabled.value(first) == pytest.approx(before, abs=enabled.facts.reading)

    def test_a_command_to_an_unknown_axis_is_refused(self, enabled: BusUnderTest) -> None:
        with pytest.raises(DeviceError, match="unknown"):
            enabled.bus.exchange({"unknown": 0.0})
        assert all(sample.valid for sample in enabled.pump(0.0).values())

    def test_time_of_samples_runs_forward_and_their_age_is_small(self, enabled: BusUnderTest) -> None:
        earlier = enabled.pump(0.0)
        for _ in range(20):
            later = enabled.pump(0.0)
            for axis in enabled.bus.axes:
                assert later[axis].time_s > earlier[axis].time_s
                assert 0.0 <= later[axis].age_s < enabled.facts.silence_s
            earlier = later

    def test_a_sample_given_out_never_changes(self, enabled: BusUnderTest) -> None:
        first = enabled.bus.axes[0]
        samples = enabled.pump(0.0)
        kept = samples[first]
        enabled.pump(enabled.facts.settle_s, offset(enabled, [first], enabled.facts.near))
        assert samples[first] is kept  # a sample is frozen: the bus made other samples in another mapping
