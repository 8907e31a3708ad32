"""The weighted line: exact data, the limits of its weights, and the coverage of its intervals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import linregress, t

from contid_fit.calibrate.line import fit_line

X = np.array([40.0, 40.0, 60.0, 60.0, 80.0, 80.0, 100.0, 100.0])
Y = 0.0013 * X - 0.2774


def test_exact_data_are_fitted_exactly_with_any_weights() -> None:
    for variances in (np.zeros(8), np.ones(8), 10.0 ** np.arange(-8.0, 0.0)):
        line, errors = fit_line(X, Y, variances)
        assert line == pytest.approx((0.0013, -0.2774), rel=1e-9)
        assert (max(errors) < 1e-9) == (not variances.any())


def test_without_known_variances_it_is_the_ordinary_line() -> None:
    y = Y + np.random.default_rng(1).normal(0.0, 0.02, 8)
    line, errors = fit_line(X, y, np.zeros(8))
    ordinary = linregress(X, y)
    assert line == pytest.approx((ordinary.slope, ordinary.intercept), rel=1e-9)
    assert errors == pytest.approx((ordinary.stderr, ordinary.intercept_stderr), rel=1e-6)


@pytest.mark.parametrize("common", [0.0, 0.01, 0.1])
def test_intervals_hold_for_values_of_different_accuracy(common: float) -> None:
    """Nominal coverage, or more where the common scatter cannot be distinguished from zero."""
    rng = np.random.default_rng(7)
    own = np.array([0.06, 0.02, 0.05, 0.01, 0.04, 0.01, 0.03, 0.01])
    quantile = float(t.ppf(0.975, 6))
    rounds, held = 300, np.zeros(2)
    for _ in range(rounds):
        y = Y + rng.normal(0.0, np.hypot(own, common))
        line, errors = fit_line(X, y, own**2)
        held += np.abs(np.array(line) - (0.0013, -0.2774)) <= quantile * np.array(errors)
    assert min(held / rounds) > 0.92
