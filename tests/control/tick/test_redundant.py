"""Redundant motion: what of it the bounds of a tick allow, and corrections of the tip inside them."""

from __future__ import annotations

import numpy as np
import pytest

from contid.control.tick.limits import AxisLimits
from contid.control.tick.ways.redundant import Redundant, _bounded

LOW, HIGH = np.array([-0.5, -0.5]), np.array([0.5, 0.5])


def redundant(low: np.ndarray = LOW, high: np.ndarray = HIGH) -> Redundant:
    limits = [AxisLimits(-9.0, 9.0, 4.0, 0.25)] * len(low)
    J = np.eye(1, len(low))
    return Redundant(limits, low, high, lambda at: at[:1], np.zeros(1), J, J.T, 1e-9)


@pytest.mark.parametrize(
    ("freely", "needed", "share"),
    [
        ((0.1, 0.2), (0.0, 0.0), 1.0),
        ((1.0, -2.0), (0.0, 0.0), 0.25),
        ((1.0, 0.0), (0.25, 0.0), 0.25),
        ((-1.0, 0.0), (0.25, 0.0), 0.75),
        ((1.0, 1e-9), (0.0, 3.0), 0.5),  # an axis that hardly moves does not count
        ((1.0, 0.5), (1.0, 0.0), -0.5),  # one that is too far ahead has to come back
        ((1.0, 1.0), (2.0, -2.0), 1.0),  # no share keeps both bounds
    ],
)
def test_all_axes_take_the_share_that_the_tightest_bound_allows(
    freely: tuple[float, float], needed: tuple[float, float], share: float
) -> None:
    assert redundant()._share(np.array(freely), np.array(needed)) == pytest.approx(share)


@pytest.mark.parametrize(("gap", "step"), [(0.2, 0.2), (0.25, 0.25), (0.75, 0.5), (1.5, 0.75), (2.5, 1.0)])
def test_a_gap_is_closed_by_what_the_axes_can_brake_from(gap: float, step: float) -> None:
    """Of 0.75 a step of 0.5 leaves 0.25, with 0.25 less per tick; the other axis keeps the proportion."""
    assert redundant()._braked(np.array([gap, -0.5 * gap]), np.zeros(2)) == pytest.approx([step, -0.5 * step])
    along = redundant()._braked(np.array([gap + 2.0, 0.0]), np.array([2.0, 0.0]))
    assert along == pytest.approx([2.0 + step, 0.0])


def test_a_step_is_the_shortest_one_where_no_bound_is_met() -> None:
    rng, wide = np.random.default_rng(8), np.full(5, 9.0)
    for _ in range(20):
        J, error = rng.normal(size=(2, 5)), rng.normal(size=2)
        assert _bounded(J, error, -wide, wide) == pytest.approx(np.linalg.lstsq(J, error, rcond=None)[0])


@pytest.mark.parametrize(
    ("error", "step"),
    [(0.3, (0.1, 0.1, 0.1)), (0.9, (0.2, 0.3, 0.4)), (1.5, (0.2, 0.3, 1.0)), (-1.5, (-0.5, -0.5, -0.5))],
)
def test_axes_beyond_their_bound_stop_there_and_the_others_take_the_rest(
    error: float, step: tuple[float, ...]
) -> None:
    high = np.array([0.2, 0.3, 9.0])
    assert _bounded(np.ones((1, 3)), np.array([error]), np.full(3, -9.0), high) == pytest.approx(step)
    assert _bounded(np.ones((1, 3)), np.array([-error]), -high, np.full(3, 9.0)) == pytest.approx(
        np.negative(step)
    )
    assert not _bounded(np.ones((1, 3)), np.array([error]), np.zeros(3), np.zeros(3)).any()
