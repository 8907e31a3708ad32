"""The limiter keeps its limits for any input and leaves alone what is inside them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.control.tick.limits import (
    ACCELERATION,
    POSITION,
    REFUSED,
    VELOCITY,
    AxisLimits,
    axis_limits,
    brake_step,
    limit,
    limit_axis,
)

SCALES = st.sampled_from([1.0, 0.05, 1e5])  # plain, lengths in m, pressures in Pa
WILD = st.one_of(
    st.floats(-3.0, 3.0),
    st.sampled_from([math.nan, math.inf, -math.inf, 0.0, 1.0, -1.0, 1e300, -1e300]),
)


def run(limits: AxisLimits, targets: list[float], start: float) -> list[tuple[float, int]]:
    last, step, before, out = start, 0.0, start, []
    for target in targets:
        command, flags = limit_axis(limits, last, step, target, target - before)
        out.append((command, flags))
        last, step, before = command, command - last, target
    return out


@settings(max_examples=200)
@given(
    st.lists(WILD, min_size=1, max_size=60),
    st.floats(-1.0, 1.0),
    st.floats(1e-4, 2.0),
    st.floats(1e-5, 2.0),
    SCALES,
)
def test_every_limit_holds_for_any_input(
    targets: list[float], start: float, step: float, change: float, scale: float
) -> None:
    limits = AxisLimits(-scale, scale, step * scale, change * scale)
    last, last_step = start * scale, 0.0
    for command, _ in run(limits, [t * scale for t in targets], last):
        assert limits.lower <= command <= limits.upper
        now = command - last
        assert abs(now) <= limits.step * (1 + 1e-8)
        assert abs(now - last_step) <= limits.change * (1 + 1e-8)
        last, last_step = command, now


@settings(max_examples=100)
@given(st.lists(WILD, min_size=1, max_size=60), st.floats(1.0, 4.0), st.booleans(), st.floats(1e-3, 1.0))
def test_outside_a_limit_only_inward(targets: list[float], start: float, below: bool, change: float) -> None:
    limits = AxisLimits(-1.0, 1.0, 0.3, change)
    last = -start if below else start
    for command, _ in run(limits, targets, last):
        if abs(last) > 1.0:
            assert abs(command) <= abs(last)
        else:
            assert abs(command) <= 1.0
        last = command


@given(st.floats(1.0, 4.0), st.booleans(), st.floats(1e-3, 1.0))
def test_outside_a_limit_an_axis_stays_with_its_target(start: float, below: bool, change: float) -> None:
    """It is held there, and a target further out does not pull it inside either."""
    last = -start if below else start
    limits = AxisLimits(-1.0, 1.0, 0.3, change)
    assert run(limits, [last] * 20, last) == [(last, 0)] * 20
    further = last * 1.5
    assert [command for command, _ in run(limits, [further] * 20, last)] == [last] * 20


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=80), st.floats(0.05, 0.5), st.floats(0.01, 0.5))
def test_what_is_inside_passes_bit_for_bit(accelerations: list[float], step: float, change: float) -> None:
    """Any motion that keeps the limits by itself (here: far from the ends) is not touched."""
    limits = AxisLimits(-1e3, 1e3, step, change)
    position, pace, path = 0.3, 0.0, []
    for share in accelerations:
        pace = min(max(pace + share * change, -step), step)
        position += pace
        path.append(position)
    assert [command for command, _ in run(limits, path, 0.3)] == path
    assert all(flags == 0 for _, flags in run(limits, path, 0.3))


def test_a_motion_that_just_stops_at_the_end_passes() -> None:
    """Full speed, then full braking into the limit: the exact boundary of what is allowed."""
    limits = AxisLimits(0.0, 1.0, 0.05, 0.01)
    steps = [0.01, 0.02, 0.03, 0.04, 0.05, 0.05, 0.05, 0.04, 0.03, 0.02, 0.01]
    start = 1.0 - sum(steps)
    path, position = [], start
    for step in steps:
        position += step
        path.append(min(position, 1.0))
    ran = run(limits, path, start)
    assert [position for position, _ in ran] == pytest.approx(path, abs=1e-12)
    assert not any(flags for _, flags in ran)


def test_a_jump_arrives_without_overshoot() -> None:
    limits = AxisLimits(-1.0, 1.0, 0.02, 0.001)
    commands = [command for command, _ in run(limits, [0.5] * 100, 0.0)]
    assert commands == sorted(commands)
    assert commands[-1] == 0.5


def test_a_late_start_catches_a_moving_target_and_then_follows_it_exactly() -> None:
    limits = AxisLimits(-10.0, 10.0, 0.03, 0.001)
    targets = [0.2 + 0.01 * k for k in range(200)]
    out = run(limits, targets, 0.0)
    assert [c for c, _ in out[-100:]] == targets[-100:]
    assert max(c - t for (c, _), t in zip(out, targets, strict=True)) < 0.001


@given(st.floats(0.0, 5.0), st.floats(1e-3, 1.0))
def test_brake_step_is_the_greatest_that_stops(room: float, change: float) -> None:
    def travel(step: float) -> float:
        total = 0.0
        while step > 0.0:
            total += step
            step -= change
        return total

    step = brake_step(room, change)
    assert travel(step) <= room * (1 + 1e-9) + 1e-12
    assert travel(step * (1 + 1e-6) + 1e-9) > room * (1 - 1e-9)


@pytest.mark.parametrize(
    ("target", "flag"), [(2.0, POSITION), (math.nan, REFUSED), (0.9, VELOCITY | ACCELERATION)]
)
def test_flags_name_what_bound(target: float, flag: int) -> None:
    limits = AxisLimits(-1.0, 1.0, 0.1, 0.15)
    _, flags = limit_axis(limits, 0.0, 0.0, target, 0.0)
    assert flags & flag == flag


def test_several_axes_are_independent() -> None:
    limits = axis_limits((0.0, 0.0), (1.0, 1.0), (10.0, 10.0), (2000.0, 2000.0), period_s=0.01)
    commands, flags = limit(limits, (0.5, 0.5), (0.0, 0.0), (0.55, 0.9), (0.0, 0.0))
    assert commands == pytest.approx((0.55, 0.6))
    assert flags[0] == 0
    assert flags[1] == VELOCITY | ACCELERATION


@pytest.mark.parametrize("change", [1.0, 0.03])
def test_an_axis_that_brakes_from_the_greatest_step_needs_all_of_its_room(change: float) -> None:
    """The steps of the ticks, each less by the greatest change until it stands, add up to the room."""
    for room in (0.05 * k * change for k in range(1, 250)):
        step = brake_step(room, change)
        needed = sum(max(step - k * change, 0.0) for k in range(int(step / change) + 2))
        assert needed == pytest.approx(room, rel=1e-9)


@pytest.mark.parametrize("room", [0.0, -1e-3, -0.5, -3.0])
def test_without_room_there_is_no_step(room: float) -> None:
    assert brake_step(room, 0.1) == 0.0
