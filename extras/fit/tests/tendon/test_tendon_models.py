"""Least energy and derivatives of the tendon models against scipy and finite differences."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import minimize

from contid.kinematics.array import Array
from contid_fit.calibrate.tendon import fit
from contid_fit.calibrate.tendon.elastic import Elastic, series
from contid_fit.calibrate.tendon.models import ElasticBends, LinearBends, Nominal, Prediction, RecordingModel
from contid_fit.calibrate.tendon.parameters import Parameters, group
from contid_fit.calibrate.tendon.recording import TendonRecording

COUNT = (3, 4)
ANGLES = np.array([0.1, 2.2, 4.3, 0.6, 2.1, 3.9, 5.3])
NOMINAL = Nominal((0.06, 0.05), 4e-3, ANGLES, COUNT, (1e-3, -2e-3, 5e-3))


def pulls(rows: int, seed: int = 3) -> Array:
    """A smooth walk that tightens and slackens every tendon."""
    random = np.random.default_rng(seed)
    corners = random.uniform(-2e-3, 2.5e-3, (rows // 8 + 2, len(ANGLES)))
    at = np.linspace(0.0, len(corners) - 1.001, rows)
    low = at.astype(int)
    walk: Array = corners[low] + (at - low)[:, None] * (corners[low + 1] - corners[low])
    return walk


def robot(friction: float, through: bool = True) -> Elastic:
    random = np.random.default_rng(8)
    return Elastic(
        COUNT,
        random.uniform(3.6e-3, 4.4e-3, 7),
        ANGLES,
        np.array([0.2] if through else []),
        400.0,
        random.uniform(-2e-4, 4e-4, 7),
        np.array([5e-6, 8e-6]),
        random.uniform(-0.1, 0.1, 4),
        np.full(2, friction),
        np.array([1e-4, 5e-5]),
        through,
    )


def energy(arm: Elastic, bends: Array, before: Array, arrived: Array) -> float:
    """The energy of the module's first lines, section by section and tendon by tendon."""
    total = 0.0
    for k in range(2):
        own = slice(2 * k, 2 * k + 2)
        total += 0.5 * arm.stiffness_m2[k] * float(np.sum((bends[own] - arm.rest_rad[own]) ** 2))
        total += arm.friction_m2[k] * math.hypot(*(bends[own] - before[own]))
    for i in range(7):
        taken = 0.0
        for k in (0,) if i < 3 else (0, 1) if arm.through else (1,):
            angle = arm.angle_rad[i] + (arm.twist_rad[0] if i >= 3 and k == 0 else 0.0)
            along = math.cos(angle) * bends[2 * k] + math.sin(angle) * bends[2 * k + 1]
            taken += arm.radius_m[i] * along
        e = max(0.0, arrived[i] + arm.offset_m[i] - taken)
        total += e**2 / 2.0 + arm.hardening_per_m * e**3 / 3.0
    return total


def least_energy(arm: Elastic, start: Array, before: Array, arrived: Array, scale: float) -> float:
    found = minimize(
        lambda x: energy(arm, x, before, arrived) / scale,
        start,
        method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-13, "maxfev": 4000},
    )
    return float(found.fun)


@pytest.mark.parametrize(("friction", "through"), [(0.0, True), (2e-7, True), (2e-7, False)])
def test_every_row_is_the_minimum_that_scipy_finds(friction: float, through: bool) -> None:
    arm = robot(friction, through)
    pull = pulls(20)
    found = series(arm, pull)
    before, arrived = arm.rest_rad, pull[0]
    width = arm.play_m[arm.section]
    for row, each in enumerate(pull):
        arrived = np.array([min(q + r, max(q - r, d)) for q, d, r in zip(each, arrived, width, strict=True)])
        scale = energy(arm, before, before, arrived) + 1e-9
        by_scipy = min(
            least_energy(arm, start, before, arrived, scale) for start in (before, found.bends[row])
        )
        # Smoothing of the friction costs at most F times its scale.
        mine = energy(arm, found.bends[row], before, arrived) / scale
        assert mine <= by_scipy + 1e-9 + 2.0 * friction * 2e-3 / scale
        before = found.bends[row]
    assert (found.elongation_m < 0.0).any()
    assert (found.elongation_m > 0.0).any()


MODELS: dict[str, Callable[[], RecordingModel]] = {
    "linear": lambda: LinearBends(NOMINAL),
    "play": lambda: LinearBends(NOMINAL, offsets=True, with_play=True),
    "statics": lambda: ElasticBends(NOMINAL, friction=False),
    "friction": lambda: ElasticBends(NOMINAL),
    "sheaths": lambda: ElasticBends(NOMINAL._replace(through=False)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_derivatives_are_those_of_finite_differences(name: str) -> None:
    model = MODELS[name]()
    pull = pulls(24, seed=11)
    spread = model.parameters.spread
    random = np.random.default_rng(2)
    vector = model.parameters.expected + 0.3 * spread * random.normal(size=len(spread))
    rows = model.rows(vector, pull)
    for column in range(len(vector)):
        step = np.zeros(len(vector))
        step[column] = 1e-4 * spread[column]
        ahead, behind = model.rows(vector + step, pull).tip_m, model.rows(vector - step, pull).tip_m
        by_difference = (ahead - behind) / (2.0 * step[column])
        error = np.abs(by_difference - rows.by[:, :, column]).max() * spread[column]
        assert error < 5e-6, (column, error)  # of 5e-3


class _Cubic:
    """Tips whose x is the cube of one parameter."""

    parameters = Parameters((group("p", ("p",), 1.0, 10.0),))

    def rows(self, vector: Array, pull_m: Array) -> Prediction:
        tips, by = np.zeros((len(pull_m), 3)), np.zeros((len(pull_m), 3, 1))
        tips[:, 0], by[:, 0, 0] = vector[0] ** 3, 3.0 * vector[0] ** 2
        return Prediction(tips, by, tips)


@pytest.mark.parametrize(("evaluations", "converged"), [(100, True), (3, False)])
def test_a_fit_that_is_given_up_states_it(
    evaluations: int, converged: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    tips = np.tile((8.0, 0.0, 0.0), (6, 1))
    data = TendonRecording("cubes", ("a", "a", "b", "b", "c", "c"), ("s",), np.zeros((6, 1)), tips)
    monkeypatch.setattr(fit, "_EVALUATIONS", evaluations)
    found = fit.fit_model(_Cubic(), data)
    assert found.converged is converged
    assert bool(abs(found.vector[0] - 2.0) < 1e-3) is converged
