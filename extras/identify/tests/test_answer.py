"""The answer of an axis beside the equation integrated by scipy on a grid a hundred times finer."""

from __future__ import annotations

import numpy as np
import pytest

from contid_identify.answer import CommandedTrace, answer, first_order
from tests.oracles.integrated_lag import PERIOD_S, integrated


@pytest.mark.parametrize(("delay_s", "lag_s"), [(0.0437, 0.031), (0.0, 0.2), (0.2204, 0.004)])
def test_it_is_the_solution_of_the_equation(delay_s: float, lag_s: float) -> None:
    rng = np.random.default_rng(3)
    sent = np.cumsum(rng.normal(size=400)) * 0.1
    at_s = np.arange(0.5, 3.9, 0.0131)
    expected = integrated(sent, at_s, delay_s, lag_s)
    assert np.abs(answer(sent, PERIOD_S, at_s, delay_s, lag_s) - expected).max() < 2e-3 * np.ptp(sent)


def test_without_a_lag_it_is_the_late_command() -> None:
    sent = np.arange(10.0)
    found = answer(sent, 1.0, np.array([0.0, 2.0, 2.7, 3.2]), 0.5, 0.0)
    assert found.tolist() == [0.0, 1.0, 2.0, 2.0]


def test_many_columns_are_each_alone() -> None:
    rng = np.random.default_rng(1)
    sent = rng.normal(size=(50, 3))
    at_s = np.linspace(0.0, 0.45, 31)
    both = answer(sent, PERIOD_S, at_s, 0.013, 0.05)
    for k in range(3):
        assert both[:, k] == pytest.approx(answer(sent[:, k], PERIOD_S, at_s, 0.013, 0.05))


def test_the_lag_starts_at_rest() -> None:
    assert first_order(np.full(5, 7.0), PERIOD_S, 0.1).tolist() == [7.0] * 5
    trace = CommandedTrace(PERIOD_S, np.arange(3.0), np.arange(4.0), np.zeros((4, 1)))
    assert trace.picked(np.array([1, 3])).at_s.tolist() == [1.0, 3.0]
