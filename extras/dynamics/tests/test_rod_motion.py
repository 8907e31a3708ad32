"""Rods in motion: releases computed by SoRoSim, energy, stability, frequencies of beams, and statics."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from contid import ElasticRod, Wrench
from contid.kinematics.array import Array
from contid_dynamics.rod import STRAINS, MovingRod
from tests.kernels.moving_bars import bar
from tests.oracles.elastic_rods import RODS, TO_MODEL
from tests.support.shared_data import shared_data

#: First roots of cos x cosh x = -1 of a clamped and free beam.
BEAM_ROOTS = (1.875104068711961, 4.694091132974174, 7.854757438237613)


def rod_of(name: str, count: int, damping_s: float) -> MovingRod:
    modulus, poisson, density, radius, length = RODS[name]
    return bar(count, length, radius, modulus, poisson, density, damping_s)


def release_error(name: str, number: int, count: int, step_s: float) -> float:
    """RMS distance of the tip from SoRoSim's over 10 s, as a part of the length.

    The first line has the damping time and gravity, the second the wrenches that hold middle and tip until
    they are let go; moments and forces keep their direction. `tests/oracles/elastic_rods.py` has the axes.
    """
    table = np.loadtxt(shared_data(f"rod-releases/{name}_{number}.txt"))
    gravity = table[0, 10:13][TO_MODEL]
    moments, forces = (
        table[1, [1, 7, 2, 8, 3, 9]].reshape(3, 2),
        table[1, [4, 10, 5, 11, 6, 12]].reshape(3, 2),
    )
    rod = rod_of(name, count, float(table[0, 0]))
    held = {
        node: np.concatenate((forces[TO_MODEL, k], moments[TO_MODEL, k]))
        for k, node in enumerate((count // 2 - 1, count - 1))
    }
    for share in np.linspace(0.05, 1.0, 20):
        rod.load(
            gravity_m_s2=tuple(share * gravity),
            wrenches={node: (share * wrench).tolist() for node, wrench in held.items()},
        )
        rod.settle()
    rod.load(gravity_m_s2=tuple(gravity))
    tips = rod.run(10.0, step_s, every=round(0.005 / step_s))[:, 0, :3]
    expected = table[3:, 10:13][:, TO_MODEL]
    error: float = np.sqrt(np.mean(np.sum((tips - expected) ** 2, axis=1))) / RODS[name][4]
    return error


@pytest.mark.parametrize("numbers", [(1, 2, 3), pytest.param(range(1, 7), marks=pytest.mark.campaign)])
@pytest.mark.parametrize("name", RODS)
def test_releases_are_those_of_sorosim(name: str, numbers: Sequence[int]) -> None:
    errors = [release_error(name, number, 24, 2.5e-3) for number in numbers]
    assert np.median(errors) < 1e-3
    assert max(errors) < 2.5e-3


@pytest.mark.parametrize("step_s", [1e-3, 2.5e-3])
@pytest.mark.parametrize("name", RODS)
def test_energy_is_kept_for_ten_seconds_without_damping(name: str, step_s: float) -> None:
    """From three quarters of the length aside: a large motion in space."""
    rod, rest = rod_of(name, 12, 0.0), rod_of(name, 12, 0.0)
    modulus, _, _, radius, length = RODS[name]
    push = 3.0 * modulus * 0.25 * math.pi * radius**4 / length**2
    for share in np.linspace(0.1, 1.0, 10):
        wrench = (share * push * np.array([1.0, 0.3, -0.5, 0.0, 0.0, 0.0])).tolist()
        rod.load(gravity_m_s2=(0.0, 0.0, -9.81), wrenches={11: wrench})
        rod.settle()
    rod.load(gravity_m_s2=(0.0, 0.0, -9.81))
    rest.load(gravity_m_s2=(0.0, 0.0, -9.81))
    rest.settle()
    given = rod.energy_j - rest.energy_j
    for _ in range(20):
        rod.run(0.5, step_s)
        assert abs(rod.energy_j - rest.energy_j - given) < 1e-3 * given


@pytest.mark.parametrize("step_s", [5e-4, 1e-3, 2.5e-3])
@pytest.mark.parametrize("side", [0.0, 9.81])
def test_a_tip_mass_of_20_g_on_a_rod_of_40_g_per_m_is_stable(side: float, step_s: float) -> None:
    light = bar(12, 0.4, 3.26e-3, 70e6, 0.4, 1200.0, 0.003)
    ends = light.elements.ends.copy()
    ends[-1] += 0.020, 0.020 * 0.005**2
    rod = MovingRod(replace(light.elements, ends=ends), stiffness_of(light), 0.003)
    rod.load(gravity_m_s2=(side, 0.0, 9.81 - side), wrenches={11: [0.1, 0.03, 0.0, 0.0, 0.0, 0.0]})
    rod.run(1.0, step_s)
    rod.load(gravity_m_s2=(side, 0.0, 9.81 - side))
    energies = []
    for _ in range(20):
        rod.run(0.25, step_s)
        energies.append(rod.energy_j)
    # It only loses energy, to the rounding of an energy that has small ripples within a step.
    swing = energies[0] - energies[-1]
    assert swing > 0.0
    assert max(later - earlier for earlier, later in itertools.pairwise(energies)) < 1e-3 * swing


def stiffness_of(rod: MovingRod) -> Array:
    stiffness = np.zeros((rod.count, STRAINS))
    h = rod.elements.lengths[0]
    turns = 70e6 * 0.25 * math.pi * 3.26e-3**4 / h
    stiffness[:, :3] = turns, turns, turns / 1.4
    return stiffness


def test_modes_of_a_straight_bar_are_those_of_eulers_beam() -> None:
    """``f = x^2 / (2 pi L^2) sqrt(EI / m)``; rotary inertia is far below a thousandth here."""
    modulus, _, density, radius, length = RODS["spring_steel"]
    found = rod_of("spring_steel", 48, 0.004).modes()
    per_m = density * math.pi * radius**2
    for k, root in enumerate(BEAM_ROOTS):
        expected = (
            root**2 / (2 * math.pi * length**2) * math.sqrt(modulus * 0.25 * math.pi * radius**4 / per_m)
        )
        assert found.frequency_hz[2 * k] == pytest.approx(expected, rel=3e-3)
        assert found.ratio[2 * k] == pytest.approx(math.pi * expected * 0.004, rel=1e-2)


def test_a_small_swing_has_the_frequency_and_damping_of_its_mode() -> None:
    rod = rod_of("spring_steel", 16, 0.004)
    rod.load(wrenches={15: [2e-4, 0.0, 0.0, 0.0, 0.0, 0.0]})
    rod.settle()
    rod.load()
    tips = rod.run(3.0, 5e-4)[:, 0, 0]
    mode = rod_of("spring_steel", 16, 0.004).modes()
    crossings = np.flatnonzero(np.diff(np.sign(tips[400:])))
    rate = (len(crossings) - 1) / 2.0 / ((crossings[-1] - crossings[0]) * 5e-4)
    damped = mode.frequency_hz[0] * math.sqrt(1.0 - mode.ratio[0] ** 2)
    assert rate == pytest.approx(damped, rel=3e-3)
    peaks = np.abs(tips[400:]).reshape(-1, 100).max(axis=1)
    decay = np.polyfit(0.05 * np.arange(len(peaks)), np.log(peaks), 1)[0]
    assert -decay == pytest.approx(mode.ratio[0] * 2 * math.pi * mode.frequency_hz[0], rel=0.03)


def test_it_rests_where_the_statics_of_elastic_rods_do() -> None:
    """Another solver and another formulation: the Cosserat rod with shear of `ElasticRod`."""
    rng = np.random.default_rng(4)
    modulus, poisson, density, radius, length = RODS["spring_steel"]
    steel = ElasticRod(length, radius, modulus_pa=modulus, poisson=poisson, density_kg_m3=density, si=True)
    scale = modulus * 0.25 * math.pi * radius**4 / length**2
    for _ in range(4):
        rod = rod_of("spring_steel", 48, 0.0)
        gravity, force = rng.normal(size=3), scale * rng.normal(size=3)
        rod.load(gravity_m_s2=tuple(gravity), wrenches={47: [*force, 0.0, 0.0, 0.0]})
        rod.settle()
        found = steel.statics([length], loads=[Wrench(length, force)], gravity=gravity)
        assert np.linalg.norm(rod.poses[-1, :3] - found.points[-1]) < 5e-5


def test_motion_that_has_died_out_is_the_equilibrium() -> None:
    rod = rod_of("tpu", 12, 0.02)
    rod.load(gravity_m_s2=(2.0, 1.0, 3.0), wrenches={11: [0.02, -0.01, 0.0, 0.0, 1e-3, 0.0]})
    rod.run(20.0, 2.5e-3, every=8000)
    moved = rod.poses[-1, :3]
    rod.settle()
    assert np.linalg.norm(moved - rod.poses[-1, :3]) < 1e-7


def test_arrays_of_other_sizes_are_refused() -> None:
    rod = rod_of("tpu", 4, 0.0)
    with pytest.raises(ValueError, match="six numbers per element"):
        rod.load(strains=np.zeros((3, 6)))
    with pytest.raises(ValueError, match="six numbers per element"):
        rod.put(np.zeros((4, 4)))
    with pytest.raises(ValueError, match="nodes"):
        rod.run(0.1, 0.01, nodes=[5])


def test_the_finest_arm_that_a_file_may_describe_has_room() -> None:
    """Eight sections of 32 elements."""
    assert rod_of(next(iter(RODS)), 256, 0.0).count == 256
