"""Steps on the way to a far answer: how axes brake together, and what each may do in a tick."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.control.tick.limits import AxisLimits
from contid.control.tick.ways.joint_steps import braked, feasible_part, stands, stop_ratio, unbounded_steps

CHANGE = 0.25
LIMITS = [AxisLimits(-100.0, 100.0, 4.0, CHANGE)] * 2
STEPS = st.floats(-4.0, 4.0)
FREE = np.full(2, np.inf)


@given(st.integers(1, 16), STEPS)
def test_axes_that_brake_stop_together_on_a_straight_line(ticks: int, ratio: float) -> None:
    """The fastest one by its greatest change in every tick; together they go as far as stated."""
    fastest = np.array([ticks * CHANGE, ticks * CHANGE * ratio / 4.0])
    steps = [fastest]
    while np.any(steps[-1]):
        steps.append(braked(LIMITS, steps[-1], -FREE, FREE))
    assert len(steps) == ticks + 1
    for before, after in pairwise(steps):
        assert before[0] - after[0] == pytest.approx(CHANGE)
        assert after == pytest.approx(after[0] / fastest[0] * fastest)
    assert np.sum(steps, axis=0) == pytest.approx(stop_ratio(LIMITS, fastest) * fastest)


def test_an_axis_near_its_end_brakes_by_itself_and_one_at_rest_stays() -> None:
    low, high = np.array([-1.0, -1.0]), np.array([0.5, 1.0])
    assert braked(LIMITS, np.array([1.0, 0.5]), low, high) == pytest.approx([0.5, 0.375])
    assert braked(LIMITS, np.zeros(2), low, high).tolist() == [0.0, 0.0]
    assert stop_ratio(LIMITS, np.array([0.1, -0.1])) == 1.0


@pytest.mark.parametrize(
    ("paces", "part"),
    [
        ((0.0, 0.0), 1.0),
        ((0.25, -0.25), 1.0),
        ((1.0, 0.0), 0.25),
        ((-1.0, 0.0), 0.5),
        ((0.5, -2.0), 0.125),
        ((1.0, -0.1), 0.25),
    ],
)
def test_a_pace_is_shared_by_all_axes_up_to_what_one_of_them_may_do(
    paces: tuple[float, float], part: float
) -> None:
    assert feasible_part(np.array(paces), np.array([-0.5, -0.25]), np.array([0.25, 0.25])) == part


def test_an_axis_that_has_to_go_back_has_no_part_of_a_pace() -> None:
    assert feasible_part(np.array([1.0]), np.array([-0.5]), np.array([-0.25])) == 0.0
    assert feasible_part(np.array([-1.0]), np.array([0.25]), np.array([0.5])) == 0.0


@given(STEPS, STEPS)
def test_without_ends_only_speed_and_acceleration_bound_a_step(first: float, second: float) -> None:
    least, greatest = unbounded_steps(LIMITS, np.array([first, second]))
    for step, low, high in zip((first, second), least, greatest, strict=True):
        assert low == max(step - CHANGE, -4.0)
        assert high == min(step + CHANGE, 4.0)


def test_a_step_of_a_hundredth_of_the_change_is_rest() -> None:
    assert stands(LIMITS, np.array([0.0099, -0.0099]) * CHANGE)
    assert not stands(LIMITS, np.array([0.0, 0.0101]) * CHANGE)
    assert not stands(LIMITS, np.array([-0.0101, 0.0]) * CHANGE)
