"""Commands that take out the hysteresis of regulators, beside a play operator that this module has itself."""

from itertools import pairwise

import numpy as np
import pytest

from contid.control.tick.limits import AxisLimits
from contid.control.tick.play import NO_LEAD, led
from contid.control.tick.regulator_loops import next_loop_lead

PERIOD_S = 0.002
R = (1500.0, 1000.0, 0.0)
LIMITS = (AxisLimits(0.0, 150e3, 400.0, 10.0),) * 3


class Chambers:
    """Chambers that follow the edges of a loop only."""

    def __init__(self, pressures):
        self.pressures = np.array(pressures)

    def follow(self, regulators):
        self.pressures = np.clip(self.pressures, regulators - np.array(R), regulators + np.array(R))


def run(path):
    """Commands, and chambers behind them, for the pressures that the chambers are to have."""
    lead, chambers = NO_LEAD, Chambers(path[0])
    sent, held = [], []
    for asked in path:
        lead = next_loop_lead(R, lead, tuple(asked), LIMITS, PERIOD_S)
        sent.append(led(tuple(asked), lead.added))
        chambers.follow(np.array(sent[-1]))
        held.append(chambers.pressures)
    return np.array(sent), np.array(held)


def walk(*points, seconds=1.0, rest_s=1.0):
    """Straight lines between pressures, with rests."""
    rows = [np.tile(points[0], (2, 1))]
    for a, b in pairwise(points):
        rows.append(np.linspace(a, b, round(seconds / PERIOD_S)))
        rows.append(np.tile(b, (round(rest_s / PERIOD_S), 1)))
    return np.vstack(rows)


def test_resting_chambers_have_what_was_asked_for():
    rng = np.random.default_rng(1)
    points = rng.uniform(20e3, 120e3, (8, 3))
    path = walk(*points)
    _, held = run(path)
    ends = [
        k
        for k in range(1, len(path) - 1)
        if (path[k] == path[k - 1]).all() and (path[k + 1] != path[k]).any()
    ]
    for k in [*ends[1:], len(path) - 1]:
        assert (np.abs(held[k] - path[k]) <= 0.1 * np.array(R) + 1e-6).all()


def test_without_a_lead_they_would_be_off_by_half_the_loop():
    path = walk([50e3] * 3, [80e3] * 3)
    chambers = Chambers(path[0])
    for row in path:
        chambers.follow(row)
    assert path[-1] - chambers.pressures == pytest.approx(R)


def test_commands_of_a_resting_arm_are_constant():
    sent, _ = run(walk([50e3] * 3, [80e3] * 3, [70e3] * 3))
    assert (np.diff(sent[-200:], axis=0) == 0.0).all()


def test_the_lead_has_no_steps_and_noise_does_not_throw_it_over():
    path = walk([50e3] * 3, [80e3] * 3, seconds=0.5)
    noise = np.random.default_rng(2).normal(0.0, 5.0, path.shape)
    sent, _ = run(path + noise)
    lead = sent - path - noise
    assert np.abs(np.diff(lead, axis=0)).max() <= 0.04 * max(R)
    assert np.abs(lead).max() <= max(R)
    # A lead by the sign of each motion would jump by the loop in every other tick.
    assert np.abs(np.diff(lead[-400:], axis=0)).sum() < 4.0 * sum(R)


def test_commands_stay_inside_the_limits():
    sent, _ = run(walk([10e3] * 3, [150e3] * 3, [0.0] * 3))
    assert sent.min() == 0.0
    assert sent.max() == 150e3
    assert (sent[:, 2] == walk([10e3] * 3, [150e3] * 3, [0.0] * 3)[:, 2]).all()
