"""A rod that is let go, beside PyElastica's explicit rod from the same shape, as both are refined."""

from __future__ import annotations

import math

import elastica as ea
import numpy as np
import pytest
import tqdm

from contid.kinematics.array import Array
from tests.kernels.moving_bars import bar
from tests.oracles.elastic_rods import RODS

pytestmark = [pytest.mark.slow, pytest.mark.campaign]

SECONDS, ROWS = 0.6, 60
MODULUS, POISSON, DENSITY, RADIUS, LENGTH = RODS["tpu"]
GRAVITY = np.array([4.0, 2.0, -8.0])
PUSH = 0.8 * MODULUS * 0.25 * math.pi * RADIUS**4 / LENGTH**2 * np.array([1.0, -0.5, 0.2])


def released(count: int) -> tuple[Array, Array]:
    """Poses of the nodes when it is let go ``(count + 1, 12)``, and tips after that ``(ROWS, 3)``."""
    rod = bar(count, LENGTH, RADIUS, MODULUS, POISSON, DENSITY, 0.0)
    rod.load(gravity_m_s2=tuple(GRAVITY), wrenches={count - 1: [*PUSH, 0.0, 0.0, 0.0]})
    rod.settle()
    poses = rod.poses
    rod.load(gravity_m_s2=tuple(GRAVITY))
    step = 1e-3
    return poses, rod.run(SECONDS, step, every=round(SECONDS / ROWS / step))[:, 0, :3]


class Tips(ea.CallBackBaseClass):  # type: ignore[type-arg]
    """Keeps the tip at even times."""

    def __init__(self, every: int, rows: list[Array]) -> None:
        super().__init__()
        self.every, self.rows = every, rows

    def make_callback(self, system: ea.CosseratRod, time: float, current_step: int) -> None:
        if current_step and current_step % self.every == 0:
            self.rows.append(system.position_collection[:, -1].copy())


def elastica_tips(count: int) -> Array:
    """Tips of PyElastica's rod from the shape at which the other one is let go."""
    poses, _ = released(2 * count)

    class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.CallBacks):
        pass

    rod = ea.CosseratRod.straight_rod(
        count, np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), LENGTH, RADIUS, DENSITY,
        youngs_modulus=MODULUS, shear_modulus=MODULUS / 2.0 / (1.0 + POISSON),
    )  # fmt: skip
    # Nodes are every second one of the finer rod, directors of an element those of its middle.
    rod.position_collection[:] = poses[::2, :3].T
    frames = poses[1::2, 3:].reshape(-1, 3, 3)
    rod.director_collection[:] = np.moveaxis(frames, 0, -1).transpose(1, 0, 2)
    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(
        ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    simulator.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=GRAVITY)
    step = 0.15 * LENGTH / count / math.sqrt(MODULUS / DENSITY)
    every = math.ceil(SECONDS / ROWS / step)
    step = SECONDS / ROWS / every
    rows: list[Array] = []
    simulator.collect_diagnostics(rod).using(Tips, every=every, rows=rows)
    simulator.finalize()
    ea.integrate(ea.PositionVerlet(), simulator, SECONDS, every * ROWS, progress_bar=False)
    return np.array(rows[:ROWS])


def test_a_release_agrees_with_pyelastica_as_both_are_refined(monkeypatch: pytest.MonkeyPatch) -> None:
    """PyElastica clamps to first order in its element length: two levels are extrapolated."""
    monkeypatch.setattr(tqdm.tqdm, "monitor_interval", 0)
    coarse, fine = elastica_tips(20), elastica_tips(40)
    own = released(32)[1]
    rows = min(len(coarse), len(fine))
    expected = 2.0 * fine[:rows] - coarse[:rows]
    off = np.sqrt(np.mean(np.sum((own[:rows] - expected) ** 2, axis=1)))
    moved = np.ptp(own, axis=0).max()
    assert moved > 0.3 * LENGTH
    assert off < 0.01 * LENGTH
