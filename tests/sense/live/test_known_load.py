"""The filter of the known load is the posterior of all measurements at once."""

import numpy as np
import pytest

from contid.sense.live.known_load import DRIFT_N, MODEL_MM, KnownLoad


def posterior(prior, measurements):
    """Mean and covariance of the last force of a random walk, by one system of normal equations.

    ``measurements`` are tip [mm], derivative by the force, noise, and time since the one before [s].
    """
    mean, covariance = prior
    count = len(measurements) + 1
    information, right = np.zeros((3 * count, 3 * count)), np.zeros(3 * count)

    def add(rows, seen, spread):
        weight = np.linalg.inv(spread)
        information[:] += rows.T @ weight @ rows
        right[:] += rows.T @ weight @ seen

    blocks = [np.eye(3 * count)[3 * k : 3 * k + 3] for k in range(count)]
    add(blocks[0], mean, covariance)
    for k, (tip, by_force, noise, since_s) in enumerate(measurements, 1):
        add(blocks[k] - blocks[k - 1], np.zeros(3), since_s * DRIFT_N**2 * np.eye(3))
        add(by_force @ blocks[k], tip, noise + MODEL_MM**2 * np.eye(3))
    whole = np.linalg.inv(information)
    return (whole @ right)[-3:], whole[-3:, -3:]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_is_the_posterior_of_a_force_that_hardly_changes(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(0.0, 0.02, (3, 3))
    prior = rng.normal(0.0, 0.03, 3), root @ root.T + 1e-6 * np.eye(3)
    load = KnownLoad(*prior)
    measurements = []
    for _ in range(12):
        by_force = rng.normal(0.0, 60.0, (3, 3))
        tip = by_force @ np.array([0.01, -0.02, 0.08]) + rng.normal(0.0, 2.0, 3)
        spread = rng.normal(0.0, 0.3, (3, 3))
        measurements.append((tip, by_force, spread @ spread.T + 0.09 * np.eye(3), rng.uniform(0.02, 5.0)))
        before = load.force
        step = load.follow(tip - by_force @ before, *measurements[-1][1:])
        assert load.force == pytest.approx(before + step)
        mean, covariance = posterior(prior, measurements)
        assert load.force == pytest.approx(mean, rel=1e-6, abs=1e-9)
        assert load.covariance == pytest.approx(covariance, rel=1e-6, abs=1e-12)
        assert (load.covariance == load.covariance.T).all()
