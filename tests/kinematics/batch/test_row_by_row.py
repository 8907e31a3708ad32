"""Every row of a batch is the single call's answer, bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from contid.kinematics.batch import Targets, forward_many, inverse_many
from contid.kinematics.model import Model, build_model
from contid.robot_file.document import RobotFile
from contid.targets import ZERO3, Target

ROBOTS = ("finger", "trirack", "trirack2", "cbha", "cbha.ph", "stiffflop1", "stiffflop2")
ROWS = 40
LOAD = (0.02, -0.03, -0.04)


@pytest.fixture(scope="module", params=ROBOTS)
def model(request: pytest.FixtureRequest) -> Model:
    name, _, solver = request.param.partition(".")
    raw = yaml.safe_load((Path(__file__).parents[3] / "configs" / f"{name}.yaml").read_text())
    robot = next(iter(raw["robots"].values()))
    if solver:
        robot["solver"] = {"method": solver}
    return build_model(next(iter(RobotFile.model_validate(raw).robots.values())))


def box(model: Model, rows: int = ROWS) -> np.ndarray:
    """Actuations over the box of the limits and a little beyond it."""
    low, high = np.array(model.lower), np.array(model.upper)
    share: np.ndarray = np.random.default_rng(16).uniform(-0.05, 1.05, (rows, len(low)))
    return np.asarray(low + share * (high - low))


def reached(model: Model, rows: int = ROWS) -> np.ndarray:
    """Tips of the box, every fourth one far out of reach."""
    tips = np.array([model.forward(tuple(row)).tip_m for row in box(model, rows).tolist()])
    tips[::4] *= 1.7
    if model.dimension == 2:
        tips[:, 2] = 0.0
    return tips


def assert_same_poses(model: Model, actuations: np.ndarray, load: tuple[float, float, float]) -> None:
    found = forward_many(model, actuations, load, threads=2)
    for row, actuation in zip(found.rows, actuations.tolist(), strict=True):
        pose = model.forward(tuple(actuation), load)
        assert tuple(row["tip_m"].tolist()) == pose.tip_m
        assert tuple(row["rotation"].ravel().tolist()) == tuple(pose.rotation)
        assert tuple(row["direction"].tolist()) == pose.direction
        assert tuple(row["mid_m"].tolist()) == pose.mid_m
        assert row["stable"] == pose.stable


@pytest.mark.parametrize("load", [ZERO3, LOAD])
def test_forward(model: Model, load: tuple[float, float, float]) -> None:
    assert_same_poses(model, box(model), load)


@pytest.mark.parametrize("chained", [False, True])
def test_inverse_of_tips(model: Model, chained: bool) -> None:
    tips, seed = reached(model), box(model, 1)[0]
    found = inverse_many(model, Targets.of(tips), seed, chained=chained, threads=2)
    last = tuple(seed.tolist())
    for k, tip in enumerate(tips.tolist()):
        single = model.inverse(Target(tip_m=tuple(tip)), last)
        row = found.rows[k]
        assert tuple(row["actuation"].tolist()) == single.actuation, k
        assert row["residual_m"] == single.residual_m
        assert sorted(found.limited_by(k)) == sorted(single.limited_by)
        assert (row["iterations"], row["converged"]) == (single.iterations, single.converged)
        if chained:
            last = single.actuation


def test_shapes_that_do_not_fit_are_refused(model: Model) -> None:
    axes = len(model.axis_names)
    with pytest.raises(ValueError, match=rf"actuations: shape \(2, {axes + 1}\); expected \(rows, {axes}\)"):
        forward_many(model, np.zeros((2, axes + 1)))
    with pytest.raises(ValueError, match=r"load_n: shape \(3, 3\); expected \(2, 3\)"):
        forward_many(model, np.zeros((2, axes)), np.zeros((3, 3)))
    with pytest.raises(ValueError, match=rf"seeds: shape \(3, {axes}\); expected \(2, {axes}\)"):
        inverse_many(model, Targets.of(np.zeros((2, 3))), np.zeros((3, axes)))
    with pytest.raises(ValueError, match="threads: 0; expected 1 or more"):
        forward_many(model, np.zeros((2, axes)), threads=0)
    with pytest.raises(ValueError, match=r"tip_m: shape \(3,\); expected \(rows, 3\)"):
        Targets.of((0.0, 0.0, 0.1))


def test_no_rows_give_no_rows(model: Model) -> None:
    axes = len(model.axis_names)
    assert len(forward_many(model, np.empty((0, axes)))) == 0
    assert len(inverse_many(model, Targets.of(np.empty((0, 3))), np.zeros(axes))) == 0
