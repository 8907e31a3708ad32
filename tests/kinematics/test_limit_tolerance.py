"""Limits survive the way through rows of text: units round-trip, and a stated excess counts as inside."""

from __future__ import annotations

import numpy as np
import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.kinematics.model import Bending, build_model
from contid.robot_file.base import Quantity
from contid.robot_file.load import load_named
from contid.targets import Target
from contid.units import BAR, LIMIT_TOLERANCE_M, LIMIT_TOLERANCE_PA


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


@pytest.mark.parametrize("name", ["stiffflop1", "stiffflop2", "chambers3"])
def test_bends_that_are_wished_twice_stay_as_they_are(name: str) -> None:
    """With pressures up to 1e-7 bar above their limits, which were set to the limits: 8.4e-6 mm, of 1e-6."""
    (config,) = build_robot_configs(load_named(name), 100.0)
    model = config.model
    assert isinstance(model, Bending)
    lower, upper = np.array(model.lower), np.array(model.upper)
    rng = np.random.default_rng(7)
    changes = []
    for _ in range(100):
        near = rng.integers(0, 2, len(lower)) == 0
        pressures = lower + np.where(near, 1e-7 * BAR, upper - lower) * rng.random(len(lower))
        arcs = model.arcs(tuple(pressures.tolist()))
        found = model.of_arcs(arcs.ravel().tolist(), tuple(pressures.tolist()))
        changes.append(np.abs(model.arcs(found) - arcs)[:, 2].max() * 1e3)
    assert np.nanmax(changes) < 1e-6
    assert np.isnan(changes).sum() < 3
