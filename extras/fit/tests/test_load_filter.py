"""The filter of a force: its steps never raise the cost, and its answer is that of another solver."""

import itertools

import numpy as np
import pytest
from scipy.optimize import least_squares

from contid_fit.sense.live.load_filter import GATE, WIDTHS, LoadFilter

NOISE_MM, EXPECTED_N = 0.3, 0.2
MODEL_MM2 = 1e-4 * np.eye(3)


def tip(force):
    """A tip [mm] that stiffens so much that a plain Gauss-Newton step goes far too long."""
    return 20.0 * np.arctan(60.0 * force)


def compliance(force):
    return np.diag(20.0 * 60.0 / (1.0 + (60.0 * force) ** 2))


def cost(force, measured):
    spread = NOISE_MM**2 + MODEL_MM2[0, 0]
    return float(((measured - tip(force)) ** 2).sum() / spread + (force**2).sum() / EXPECTED_N**2)


def added(found, *measurement):
    """Every part of a measurement at once."""
    parts = found.add(*measurement)
    while True:
        try:
            next(parts)
        except StopIteration as end:
            return end.value


def settled(measured, start, steps=60):
    """The filter after one measurement, with the cost at every step."""
    found = LoadFilter(NOISE_MM, 0.4, EXPECTED_N)
    found.restart(np.array(start))
    added(found, 0.0, measured - tip(found.force), compliance(found.force), MODEL_MM2)
    costs = [cost(found.force, measured)]
    for _ in range(steps):
        tried = found.proposed()
        if tried is None:
            break
        found.judge(tip(tried) - tip(found.force), compliance(tried))
        costs.append(cost(found.force, measured))
    return found, costs


@pytest.mark.parametrize("truth", [(0.002, -0.001, 0.09), (0.0, 0.0, 0.0), (-0.05, 0.03, 0.07)])
@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (0.1, -0.1, -0.1)])
def test_the_cost_never_rises_and_ends_where_scipy_ends(truth, start):
    measured = tip(np.array(truth)) + np.array([0.1, -0.2, 0.15])
    found, costs = settled(measured, start)
    assert all(after <= before for before, after in itertools.pairwise(costs))
    spread = np.sqrt(NOISE_MM**2 + MODEL_MM2[0, 0])
    other = least_squares(
        lambda f: np.concatenate([(measured - tip(f)) / spread, f / EXPECTED_N]), np.array(truth), xtol=1e-14
    )
    assert found.force == pytest.approx(other.x, abs=2e-6)
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(
        np.sqrt(np.diag(np.linalg.inv(other.jac.T @ other.jac))), rel=1e-3
    )


def test_a_force_where_the_model_has_no_equilibrium_is_not_taken():
    found, _ = settled(np.array([5.0, 0.0, 0.0]), (0.0, 0.0, 0.0), steps=0)
    tried = found.proposed()
    assert tried is not None
    assert not found.judge(None, np.zeros((3, 3)))
    assert found.force.tolist() == [0.0, 0.0, 0.0]
    shorter = found.proposed()
    assert shorter is not None
    assert np.linalg.norm(shorter) < np.linalg.norm(tried)


def linear(force, rng, found, t_s):
    """One measurement of a tip of 50 mm/N."""
    missed = 50.0 * (np.array(force) - found.force) + rng.normal(0.0, NOISE_MM, 3)
    jump = added(found, t_s, missed, 50.0 * np.eye(3), MODEL_MM2)
    for _ in range(3):
        if (tried := found.proposed()) is not None:
            found.judge(50.0 * (tried - found.force), 50.0 * np.eye(3))
    return jump


def test_a_jump_is_seen_at_once_and_followed():
    rng, found = np.random.default_rng(2), LoadFilter(NOISE_MM, 0.4, EXPECTED_N)
    for k in range(100):
        assert not linear((0.0, 0.0, 0.0), rng, found, 0.02 * k)
    assert linear((0.0, 0.0, 0.098), rng, found, 2.0)
    assert not found.settled
    for k in range(25):
        linear((0.0, 0.0, 0.098), rng, found, 2.02 + 0.02 * k)
    assert found.settled
    assert found.force == pytest.approx([0.0, 0.0, 0.098], abs=4.0 * np.sqrt(found.covariance[0, 0]))


@pytest.mark.slow
def test_no_false_jump_in_noise():
    """20 000 measurements, 7 minutes at 50 Hz."""
    rng, found = np.random.default_rng(3), LoadFilter(NOISE_MM, 0.4, EXPECTED_N)
    assert not any(linear((0.0, 0.0, 0.02), rng, found, 0.02 * k) for k in range(20_000))


@pytest.mark.parametrize("width", WIDTHS)
def test_a_jump_is_seen_once_enough_measurements_show_it(width):
    """Of a mean of w measurements the gate is a squared distance by the covariance of the mean."""
    found = LoadFilter(NOISE_MM, 0.4, EXPECTED_N)
    for k in range(100):
        assert not added(found, 0.02 * k, np.zeros(3), 50.0 * np.eye(3), MODEL_MM2)
    spread = MODEL_MM2[0, 0] + 50.0**2 * found.covariance[0, 0] + NOISE_MM**2 / width
    size = 1.0001 * np.sqrt(GATE * spread)
    jumps = [
        added(found, 2.0 + 0.02 * k, size * np.eye(3)[1], 50.0 * np.eye(3), MODEL_MM2) for k in range(width)
    ]
    assert jumps == [False] * (width - 1) + [True]
    assert found.count == width
    assert not found.settled


def test_it_is_settled_when_its_average_is_as_long_as_the_time_constant():
    found = LoadFilter(NOISE_MM, 0.5, EXPECTED_N)
    for k in range(8):
        added(found, 0.125 * k, np.zeros(3), 50.0 * np.eye(3), MODEL_MM2)
        assert found.settled == (0.125 * k >= 0.5)


def test_without_a_measurement_no_force_is_proposed():
    assert LoadFilter(NOISE_MM, 0.4, EXPECTED_N).proposed() is None
