"""The test of residuals: what it remembers, what it converts, what explains a residual."""

import numpy as np
import pytest
from scipy.stats import chi2

from contid.sense.live.innovation_test import (
    GATE,
    NEWEST,
    REFERENCE,
    TESTS_PER_HOUR,
    Departure,
    InnovationTest,
    TipResidual,
)

NOISE_MM = 0.3
SLOPES = np.full((3, 6), 5.0)
ZERO = np.zeros((3, 3))


def residual(missed, velocity=(0.0, 0.0, 0.0), shared=ZERO, by_force=None, load=ZERO):
    slopes = np.eye(3) if by_force is None else by_force
    return TipResidual(np.array(missed), np.array(velocity), SLOPES, shared, slopes, load)


def filled(rng, count=NEWEST + REFERENCE, **keys):
    test = InnovationTest(NOISE_MM)
    for _ in range(count):
        assert test.add(residual(rng.normal(0.0, 0.05, 3), **keys)) is None
    return test


def first_departure(test, steps, rng=None):
    """Number of residuals until a departure, and it; (None, None) without."""
    for number, missed in enumerate(steps, 1):
        found = test.add(residual(missed) if not isinstance(missed, TipResidual) else missed)
        if found is not None:
            return number, found
    return None, None


@pytest.mark.parametrize("squared", [32.0, 40.0, 60.0])
def test_the_confidence_is_the_chance_of_no_such_noise_in_an_hour(squared):
    found = Departure(np.zeros(3), np.eye(3), squared)
    assert found.confidence == pytest.approx(max(0.0, 1.0 - TESTS_PER_HOUR * chi2.sf(squared, 3)), abs=1e-9)
    assert 0.0 <= Departure(np.zeros(3), np.eye(3), 5.0).confidence < 1e-12


@pytest.mark.parametrize("shape", ["step", "ramp"])
def test_steps_and_ramps_in_any_direction_leave_the_pattern(shape):
    rng = np.random.default_rng(4)
    for _ in range(6):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        sizes = [4.0] * 6 if shape == "step" else [1.0 * k for k in range(1, 8)]
        number, found = first_departure(filled(rng), [size * direction for size in sizes])
        assert found is not None
        assert found.squared_distance > GATE
        assert found.squared_distance == pytest.approx(
            float(found.shift_mm @ np.linalg.solve(found.covariance, found.shift_mm)), rel=1e-6
        )
        reached = sizes[number - 1]
        assert found.shift_mm == pytest.approx(reached * direction, abs=0.3 * reached)


def test_a_constant_error_of_the_model_is_its_pattern():
    rng = np.random.default_rng(5)
    test = InnovationTest(NOISE_MM)
    for _ in range(200):
        assert test.add(residual(np.array([9.0, -4.0, 2.0]) + rng.normal(0.0, 0.1, 3))) is None
    assert test.distance < GATE
    assert chi2.sf(GATE, 3) == pytest.approx(1.0 / 2e6, rel=0.1)  # by noise alone, in one test
    number, found = first_departure(test, [np.array([9.0, -4.0, 5.0])] * 6)
    assert number is not None
    assert found.shift_mm == pytest.approx([0.0, 0.0, 3.0], abs=0.3)


def test_what_all_newest_residuals_share_explains_their_shift():
    rng = np.random.default_rng(6)
    shift = np.array([3.0, 0.0, 0.0])
    wide = np.diag([4.0, 1e-6, 1e-6])
    steps = [residual(shift, shared=wide)] * 6
    assert first_departure(filled(rng), steps) == (None, None)
    across = [residual(shift[::-1], shared=wide)] * 6
    assert first_departure(filled(rng), across)[0] is not None


def test_an_uncertain_load_explains_a_shift_only_where_the_compliance_has_changed():
    rng = np.random.default_rng(7)
    load = np.diag([0.04, 0.0, 0.0])
    shift = np.array([3.0, 0.0, 0.0])
    softer = 40.0 * np.eye(3)
    same = first_departure(
        filled(rng, by_force=softer, load=load), [residual(shift, by_force=softer, load=load)] * 6
    )
    changed = first_departure(filled(rng, load=load), [residual(shift, by_force=softer, load=load)] * 6)
    assert same[0] is not None
    assert changed == (None, None)


def test_residuals_under_another_load_are_those_of_a_test_that_began_with_it():
    rng = np.random.default_rng(8)
    first, second = InnovationTest(NOISE_MM), InnovationTest(NOISE_MM)
    step = np.array([0.02, -0.01, 0.03])
    seen = [(rng.normal(0.0, 0.1, 3), rng.normal(0.0, 20.0, (3, 3))) for _ in range(NEWEST + REFERENCE - 1)]
    for missed, by_force in seen:
        first.add(residual(missed, by_force=by_force))
        second.add(residual(missed - by_force @ step, by_force=by_force))
    first.reload(step)
    newest = residual(rng.normal(0.0, 0.1, 3), by_force=np.eye(3))
    first.add(newest)
    second.add(newest)
    assert first.distance == pytest.approx(second.distance, rel=1e-9)
    assert first.distance > 0.0


def test_the_confirmed_residual_is_the_oldest_of_the_newest():
    rng = np.random.default_rng(9)
    test = InnovationTest(NOISE_MM)
    test.lag_s = 0.002
    seen = []
    for number in range(40):
        assert test.confirms == (number >= NEWEST)
        missed, velocity = rng.normal(0.0, 0.1, 3), rng.normal(0.0, 10.0, 3)
        seen.append(residual(missed, velocity, by_force=rng.normal(0.0, 20.0, (3, 3))))
        test.add(seen[-1])
        if test.confirms:
            missed, by_force, noise = test.confirmed
            # A velocity is known one measurement late.
            late = test.lag_s * seen[1 - NEWEST].velocity
            assert missed == pytest.approx(seen[-NEWEST].residual_mm - late)
            assert by_force == pytest.approx(seen[-NEWEST].by_force)
            assert np.all(np.linalg.eigvalsh(noise - NOISE_MM**2 * np.eye(3)) > -1e-12)


def lagging(lag_s, count, rng, test=None):
    """Residuals of a tip that swings and is ahead of its pressures; velocities are known one late."""
    test = InnovationTest(NOISE_MM) if test is None else test
    for k in range(count):
        velocity, before = (80.0 * np.array([np.sin((k - late) / 24.0), 0.0, 0.0]) for late in (0, 1))
        missed = lag_s * velocity + rng.normal(0.0, 0.1, 3)
        assert test.add(residual(missed, before)) is None
    return test


@pytest.mark.parametrize("lag_s", [0.008, -0.008])
def test_a_lag_is_learnt_with_its_sign_and_taken_out(lag_s):
    test = lagging(lag_s, 1500, np.random.default_rng(10))
    assert test.lag_s == pytest.approx(lag_s, abs=5e-4)
    missed, _, _ = test.confirmed
    assert np.abs(missed).max() < 0.5


def test_a_lag_is_bounded_and_outlives_the_pattern():
    test = lagging(0.3, 0, np.random.default_rng(11))
    rng = np.random.default_rng(12)
    for k in range(3000):
        velocity, before = (200.0 * np.array([np.sin((k - late) / 24.0), 0.0, 0.0]) for late in (0, 1))
        test.add(residual(0.1 * velocity + rng.normal(0.0, 0.1, 3), before, shared=1e4 * np.eye(3)))
    assert test.lag_s == pytest.approx(0.04)
    test.clear()
    assert test.lag_s == pytest.approx(0.04)
    assert not test.armed
    assert not test.confirms
    for _ in range(NEWEST + REFERENCE - 1):
        test.add(residual(rng.normal(0.0, 0.1, 3)))
    assert not test.armed


def test_a_slow_tip_teaches_no_lag():
    rng = np.random.default_rng(13)
    test = InnovationTest(NOISE_MM)
    for k in range(1000):
        velocity = 10.0 * np.array([np.sin(k / 24.0), 0.0, 0.0])
        test.add(residual(0.02 * velocity + rng.normal(0.0, 0.1, 3), velocity))
    assert test.lag_s == 0.0


def test_the_noise_of_pressures_is_learnt_between_its_bounds():
    """Tip noise of the tracker and of the pressures through the derivative of the tip."""
    rng = np.random.default_rng(14)
    shares = {}
    slopes = np.linalg.qr(rng.normal(size=(6, 6)))[0][:3] * 50.0
    for bar in (0.0, 0.01):
        test = InnovationTest(NOISE_MM)
        for _ in range(1500):
            missed = rng.normal(0.0, NOISE_MM, 3) + slopes @ rng.normal(0.0, bar, 6)
            test.add(TipResidual(missed, np.zeros(3), slopes, ZERO, np.eye(3), ZERO))
        still = TipResidual(np.zeros(3), np.zeros(3), slopes, ZERO, np.eye(3), ZERO)
        shares[bar] = test.noise(still)
    expected = NOISE_MM**2 * np.eye(3) + 0.01**2 * slopes @ slopes.T
    # Residuals are compared with the mean of a pattern, which has noise of its own.
    assert shares[0.01] == pytest.approx(expected, rel=0.25, abs=0.05 * np.trace(expected))
    assert np.trace(shares[0.0]) < 1.3 * 3.0 * NOISE_MM**2


def test_the_covariance_of_a_residual_grows_with_the_speed_of_the_tip():
    test = filled(np.random.default_rng(15))
    fast = residual(np.zeros(3), velocity=(100.0, 0.0, 0.0))
    grown = test.noise(fast) - test.noise(residual(np.zeros(3)))
    assert grown[0, 0] > 0.0
    assert np.abs(grown - np.diag([grown[0, 0], 0.0, 0.0])).max() < 1e-12
    shared = np.diag([1.0, 2.0, 3.0])
    assert test.noise(residual(np.zeros(3), shared=shared)) - test.noise(
        residual(np.zeros(3))
    ) == pytest.approx(shared)


@pytest.mark.parametrize("size", [5.0, 2.4, 1.9, 1.7])
def test_the_covariance_of_a_shift_is_that_of_the_difference_of_two_means(size):
    """Of n residuals and of the pattern, each with the noise of the tracker, and what the former share."""
    test, shared = InnovationTest(NOISE_MM), 0.01 * np.eye(3)
    exact = np.full((3, 6), 1e-6)

    def new(missed):
        return TipResidual(np.array(missed), np.zeros(3), exact, shared, np.eye(3), ZERO)

    for _ in range(NEWEST + REFERENCE):
        test.add(new((0.0, 0.0, 0.0)))
    number, found = first_departure(test, [new((0.0, size, 0.0))] * 4)
    assert found is not None
    expected = NOISE_MM**2 * (1.0 / number + 1.0 / REFERENCE) * np.eye(3) + shared
    assert found.covariance == pytest.approx(expected, rel=1e-6)
    assert found.shift_mm == pytest.approx([0.0, size, 0.0])


@pytest.mark.parametrize(
    "newest", [(7, 6, 5, 4, 3, 2), (6, 5, 4, 3, 2, 1), (1, 1, 1, 1, 1, 1), (2, 1, 0, 0, 0, 0)]
)
def test_the_distance_is_the_largest_of_steps_and_ramps_that_begin_in_the_newest(newest):
    """T of the module's text in one dimension, with steps of 1 to 4 residuals and ramps of 2 to 6."""
    test, missed = InnovationTest(NOISE_MM), 0.1 * np.array(newest)
    for each in [*np.zeros(REFERENCE), *missed[::-1]]:
        test.add(
            TipResidual(np.array([0, each, 0]), np.zeros(3), np.full((3, 6), 1e-6), ZERO, np.eye(3), ZERO)
        )
    shapes = [np.arange(6) < n for n in (1, 2, 3, 4)] + [np.maximum(n - np.arange(6), 0) for n in range(2, 7)]
    noise = NOISE_MM**2
    spreads = [noise * (a**2).sum() + noise / REFERENCE * a.sum() ** 2 for a in np.array(shapes, dtype=float)]
    expected = [(a @ missed) ** 2 / spread for a, spread in zip(shapes, spreads, strict=True)]
    assert test.distance == pytest.approx(max(expected), rel=1e-6)
