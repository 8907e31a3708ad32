"""Statics of rods under gravity and wrenches along them: against SoRoSim, Euler, and the equations."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from contid import ElasticRod, Robot, Wrench
from contid.kinematics.cosserat.engine import RodSolver
from contid.kinematics.cosserat.model import CosseratModel
from contid.kinematics.cosserat.section import Loads
from contid.kinematics.model import build_model
from contid.robot_file.load import load_named
from tests.oracles.elastic_rods import ALLOWED, RODS, compared, rod, shapes
from tests.oracles.rod_equations import integrate
from tests.support.shared_data import shared_data


@pytest.mark.parametrize("name", RODS)
def test_shapes_are_those_of_sorosim(name: str) -> None:
    one = rod(name)
    at, table = shapes(shared_data(f"rod-statics/{name}.csv"))
    for shape in table[:12]:
        found = compared(one, at, shape)
        assert found.distance <= ALLOWED
        assert found.angle <= math.radians(0.3)


def test_wrenches_on_a_pneumatic_arm_are_in_balance_along_it() -> None:
    """Frames at stations, ends of links among them, and the base moment, by the equations."""
    (robot,) = load_named("stiffflop2").file.robots.values()
    model = build_model(robot)
    assert isinstance(model, CosseratModel)
    fine = RodSolver(replace(model.setup, elements=48))
    rng = np.random.default_rng(5)
    stations = np.array([0.0, 17.0, model.setup.rod.sections[0].length, 47.5, 80.0, model.setup.rod.reach])
    for _ in range(6):
        loads = Loads(
            rng.uniform(-0.03, 0.03, 3),
            rng.uniform(-2.0, 2.0, 3),
            {0: rng.uniform(-0.03, 0.03, 3)},
            {0: rng.uniform(-2.0, 2.0, 3)},
            {1: rng.uniform(-1e-4, 1e-4, 3)},
            {0: rng.uniform(-1e-4, 1e-4, 3)},
        )
        pressures = rng.uniform(0.0, 1.2, 6).tolist()
        frames, coarse = np.empty((6, 12)), np.empty((6, 12))
        found = fine.statics(pressures, loads, stations, frames)
        assert found.carried == 1.0
        assert found.elements == 48
        exact = integrate(
            model.setup.rod, np.array(pressures), loads, np.array(found.base_moment_nmm), stations
        )
        assert np.abs(exact.left).max() < 1e-5
        np.testing.assert_allclose(frames, exact.frames, rtol=0.0, atol=1e-5)
        usual = model.engine.statics(pressures, loads, stations, coarse)
        assert usual.carried == 1.0
        assert usual.elements < 48
        # As the elements are doubled: to about 0.03 mm.
        np.testing.assert_allclose(coarse[:, :3], frames[:, :3], rtol=0.0, atol=0.06)


def test_a_force_on_the_tip_is_that_of_fk() -> None:
    arm = Robot("stiffflop2")
    rows = np.random.default_rng(2).uniform(0.0, 1.2, (5, 6))
    plain = arm.fk(rows, load=[0.01, 0.0, 0.03])
    under = arm.fk_under(rows, tip=[0.01, 0.0, 0.03, 0.0, 0.0, 0.0])
    for field in ("tip", "mid", "direction", "rotation"):
        np.testing.assert_allclose(under[field], plain[field], atol=1e-9)


def test_a_couple_of_forces_is_a_moment() -> None:
    # Two opposite forces at the ends of a short lever near the tip turn the rod like a moment there.
    steel = ElasticRod(600, 0.8, modulus_pa=200e9, poisson=0.33)
    push, lever = np.array([1.0, 0.0, 0.0]), 0.5
    moment = steel.statics([600], loads=[Wrench(600 - 0.5 * lever, moment=[0.0, lever, 0.0])])
    couple = steel.statics([600], loads=[Wrench(600 - lever, -push), Wrench(600, push)])
    np.testing.assert_allclose(couple.points, moment.points, atol=1e-4)


def test_a_strip_bent_by_a_moment_is_an_arc() -> None:
    """Euler: a moment at the tip bends a rod to a circle; its radius is E I / M."""
    radius, length, modulus = 1.0, 300.0, 70e9
    stiffness = modulus * 1e-6 * math.pi / 4.0 * radius**4
    moment = stiffness * math.pi / length  # half a circle
    bent = ElasticRod(length, radius, modulus_pa=modulus, poisson=0.3).statics(
        [length / 2, length], loads=[Wrench(length, moment=[0.0, moment, 0.0])]
    )
    bow = length / math.pi
    np.testing.assert_allclose(bent.points, [[bow, 0.0, bow], [2 * bow, 0.0, 0.0]], atol=1e-2)
    assert bent.carried == 1.0


def test_a_column_carries_no_more_than_its_critical_load() -> None:
    """Euler's column, clamped and free: pi^2 E I / 4 L^2."""
    radius, length, modulus = 1.0, 500.0, 200e9
    critical = math.pi**2 * modulus * 1e-6 * math.pi / 4.0 * radius**4 / (4.0 * length**2)
    column = ElasticRod(length, radius, modulus_pa=modulus, poisson=0.3)
    assert column.statics([length], loads=[Wrench(length, [0, 0, -0.98 * critical])]).carried == 1.0
    assert column.statics(
        [length], loads=[Wrench(length, [0, 0, -1.25 * critical])]
    ).carried == pytest.approx(0.8, abs=0.01)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: r.statics([700]), r"stations=\[700\]; expected: arc lengths that ascend from 0 to 600 mm"),
        (lambda r: r.statics([2, 1]), "ascend"),
        (lambda r: r.statics([1], loads=[Wrench(601)]), "wrench at 601; allowed: 0 to 600 mm"),
        (lambda r: r.statics([1], loads=[Wrench(600, [1, 2])]), "force has shape"),
        (lambda r: r.statics([1], loads=[Wrench(600, [[0, 0, 1], [1, 0, 0]])]), r"force has shape \(2, 3\)"),
        (lambda r: r.statics([1], gravity=[[]] * 3), "gravity has shape"),
        (lambda r: r.statics([1], loads=[Wrench(k) for k in range(1, 9)]), "8 points inside .* at most 7"),
        (lambda r: ElasticRod(0, 1, modulus_pa=1e9, poisson=0.3), "length=0: a positive number"),
        (lambda r: ElasticRod(1, 1, modulus_pa=1e9, poisson=0.6), "poisson=0.6; allowed"),
        (lambda r: Robot("trirack2").fk_under([0] * 6), "does not bend under wrenches"),
    ],
)
def test_mistakes_have_located_messages(call: object, message: str) -> None:
    steel = ElasticRod(600, 0.8, modulus_pa=200e9, poisson=0.33)
    with pytest.raises(ValueError, match=message):
        call(steel)  # type: ignore[operator]
