"""Limits survive the way through rows of text: units round-trip, and a stated excess counts as inside."""

from __future__ import annotations

import numpy as np
import pytest

from contid.kinematics.model import build_model
from contid.robot_file.base import Quantity
from contid.robot_file.load import load_named
from contid.targets import Target
from contid.units import LIMIT_TOLERANCE_M, LIMIT_TOLERANCE_PA


@pytest.mark.parametrize("quantity", list(Quantity))
def test_every_limit_of_a_file_comes_back_from_a_row(quantity):
    """Limits with two decimals, as written in files; 167 of 400 bar values came back larger before."""
    for hundredths in range(1, 20_000):
        limit = quantity.to_si(hundredths / 100)
        assert quantity.to_si(float(repr(quantity.from_si(limit)))) == limit


@pytest.mark.parametrize("quantity", list(Quantity))
def test_nothing_inside_a_limit_comes_back_outside(quantity):
    rng = np.random.default_rng(4)
    for _ in range(5000):
        limit = quantity.to_si(round(rng.uniform(0.1, 300.0), 2))
        value = limit * (1.0 - rng.uniform(0.0, 1e-15))
        assert quantity.to_si(float(repr(quantity.from_si(value)))) <= limit


@pytest.mark.parametrize("name", ["finger", "trirack2", "cbha", "stiffflop2"])
def test_an_excess_below_the_tolerance_is_clamped_and_one_above_is_named(name):
    (robot,) = load_named(name).file.robots.values()
    model = build_model(robot)
    tolerance = LIMIT_TOLERANCE_M if robot.quantity is Quantity.LENGTH else LIMIT_TOLERANCE_PA
    rest = list(robot.rest)
    rest[:] = [
        min(max(value, low), high) for value, low, high in zip(rest, model.lower, model.upper, strict=True)
    ]
    rest[0] = model.lower[0] - 0.5 * tolerance
    if name == "finger":
        rest[:] = [model.upper[0] + 0.5 * tolerance] * 2
    near = model.inverse(Target(actuation=tuple(rest)), robot.rest)
    assert near.converged
    inside = zip(near.actuation, model.lower, model.upper, strict=True)
    assert all(low <= value <= high for value, low, high in inside)
    rest[0] += 10.0 * tolerance if name == "finger" else -10.0 * tolerance
    far = model.inverse(Target(actuation=tuple(rest)), robot.rest)
    assert not far.converged
    assert far.limited_by
