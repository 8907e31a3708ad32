"""The curve through the rows of a stream, and the clock that plays it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.interpolate import BSpline

from contid.control.engine.live.row_clock import RowClock
from contid.control.engine.live.row_curve import RowCurve
from contid.control.engine.live.target_vector import kind_of, target_of, vector_of
from contid.targets import Target

TICK_S = 0.005


def test_it_is_the_uniform_b_spline_of_scipy() -> None:
    rows = np.random.default_rng(1).normal(size=(12, 2))
    curve = RowCurve(0, tuple(rows[0]))
    for number, row in enumerate(rows[1:].tolist(), start=1):
        curve.add(number, tuple(row), 0.02)
    spline = BSpline(np.arange(-2.0, 14.0), rows, 3)
    for phase in np.linspace(1.0, 8.9, 40):
        assert curve.at(float(phase)) == pytest.approx(spline(phase), abs=1e-12)


def test_beyond_the_last_row_it_is_straight_by_old_rules_and_before_the_first_it_stands() -> None:
    curve = RowCurve(0, (0.0,), rules=3)
    curve.add(1, (2.0,), 0.02)
    assert curve.at(4.5) == pytest.approx((9.0,))
    assert curve.at(-3.0) == (0.0,)


@pytest.mark.parametrize("period_s", [0.002, 0.02, 0.1])
def test_beyond_the_last_row_it_goes_on_with_its_second_difference(period_s: float) -> None:
    curve = RowCurve(0, (0.0, 0.0))
    for number in range(1, 61):
        curve.add(number, (float(number * number), 3.0 - number), period_s)
    assert curve.at(64.5) == pytest.approx((64.5**2 + 1.0 / 3.0, 3.0 - 64.5))


def test_lost_rows_are_filled_in_and_used_rows_stay() -> None:
    curve = RowCurve(0, (0.0,), rules=3)
    curve.add(1, (1.0,), 0.02)
    curve.at(0.0)  # uses the expected row 2
    curve.add(2, (5.0,), 0.02)
    assert curve.at(0.0) == pytest.approx((0.0 + 1.0 / 6.0,))
    curve.add(5, (8.0,), 0.02)
    assert curve.at(3.0) == pytest.approx(((2.0 + 4.0 * 6.0 + 7.0) / 6.0,))


def test_it_returns_from_expected_rows_smoothly_and_wholly() -> None:
    """Without steps of the third difference that the rows do not have; exact after 0.15 s."""
    period_s = 0.01

    def row(number: int) -> float:
        return math.sin(0.03 * number)

    curve, at = RowCurve(0, (row(0),)), []
    for number in range(1, 100):
        if not 40 < number <= 43:  # three rows wait for the fourth
            for late in range(41, 44) if number == 44 else ():
                curve.add(late, (row(late),), period_s)
            curve.add(number, (row(number),), period_s)
        at.append(curve.at(number - 2.0)[0])
    plain = [(row(k - 3) + 4.0 * row(k - 2) + row(k - 1)) / 6.0 for k in range(1, 100)]
    off = np.abs(np.array(at) - np.array(plain))[3:]
    assert off[:35].max() < 1e-12
    assert 1e-6 < off.max() < 2e-3
    assert off[-30:].max() < 1e-12
    assert np.abs(np.diff(at[3:], 3)).max() < 10.0 * np.abs(np.diff(plain[3:], 3)).max()


def test_it_does_not_run_away_from_the_rows() -> None:
    """Where the clock is wrong; and rows that are late every time do not add up."""
    curve = RowCurve(0, (0.0,))
    for number in range(1, 30):
        curve.add(number, (0.1 * number,), 0.01)
    assert curve.at(500.0) == pytest.approx((0.1 * (29 + 25),))
    late = RowCurve(0, (0.0,))
    for number in range(1, 200):
        late.at(number + 1.5)  # uses up to three rows after the newest
        late.add(number, (0.1 * number,), 0.01)
        assert late.at(number + 1.5)[0] - 0.1 * (number + 1.5) < 1e-9
    for number in range(200, 260):
        late.add(number, (0.1 * 199,), 0.01)
        assert late.at(number - 2.0)[0] < 0.1 * 199 + 0.31


def test_a_target_is_its_vector() -> None:
    target = Target(
        tip_m=(0.1, 0.2, 0.3), direction=(0.0, 0.6, 0.8), mid_m=(0.0, 0.1, 0.1),
        load_n=(0.0, 1.0, 0.0), extra={"grip": 0.5},
    )  # fmt: skip
    assert target_of(vector_of(target), target) == target
    assert kind_of(target) != kind_of(Target(tip_m=(0.1, 0.2, 0.3)))


def played(arrivals_s: Sequence[float], seconds: float) -> list[tuple[float, RowClock]]:
    """Phase behind the newest row in every tick, and the clock."""
    clock, queue, found = RowClock(TICK_S), list(arrivals_s), []
    for tick in range(int(seconds / TICK_S)):
        while queue and queue[0] <= tick * TICK_S + 1e-9:
            clock.arrived(tick * TICK_S)
            queue.pop(0)
        found.append((clock.play(tick * TICK_S) - clock.newest, clock))
    return found


@pytest.mark.parametrize("waiting", [0, 14, 300])
def test_rows_that_waited_do_not_count(waiting: int) -> None:
    found = played([0.0] * waiting + [0.02 * k for k in range(150)], 3.0)
    assert found[-1][1].period_s == pytest.approx(0.02, rel=1e-3)
    assert all(-2.2 < behind < -0.9 for behind, _ in found[200:])


@pytest.mark.parametrize("period_s", [0.005, 0.02])
def test_rows_that_waited_midway_are_no_other_period(period_s: float) -> None:
    meant_s = [period_s * k for k in range(int(3.0 / period_s))]
    found = played([2.0 if 1.915 < each < 2.0 else each for each in meant_s], 3.0)
    clock = found[-1][1]
    assert clock.period_s == pytest.approx(period_s, rel=1e-2)
    assert clock.late_s >= 0.06


@pytest.mark.parametrize("factor", [0.5, 2.0, 3.0])
def test_another_rate_is_learnt(factor: float) -> None:
    rows = [0.02 * k for k in range(50)] + [1.0 + 0.02 * factor * k for k in range(300)]
    found = played(rows, 3.5)
    assert found[-1][1].period_s == pytest.approx(0.02 * factor, rel=0.02)
    assert all(-4.0 < behind < 0.1 for behind, _ in found[-100:])


def test_the_phase_is_smooth_while_the_clock_learns() -> None:
    random = np.random.default_rng(3)
    found = played([0.02 * k + float(random.uniform(0.0, 0.01)) for k in range(200)], 4.0)
    clock = found[-1][1]
    # Relative to the newest row the phase falls back by one per row, and comes on by the rate.
    phases = np.unwrap([behind for behind, _ in found[200:]], period=1.0)
    assert np.abs(np.diff(phases) / TICK_S * 0.02 - 1.0).max() < 0.05
    assert clock.delay_s < 0.02 * 2.0 + 0.01 + 2.0 * TICK_S
