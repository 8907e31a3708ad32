"""Every row of a batch is the single call's answer, bit for bit; of unloaded pneumatic arms to rounding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from contid.kinematics.batch import Targets, forward_many, inverse_many
from contid.kinematics.batch.loop import target_of
from contid.kinematics.cosserat.model import CosseratModel
from contid.kinematics.model import Model, build_model
from contid.robot_file.document import RobotFile
from contid.targets import ZERO3
from contid_ropes.ph.model import PhModel

#: `trirack2` has the kernel of `cbha`.
ROBOTS = ("finger", "trirack", "cbha", "cbha.ph", "stiffflop1", "stiffflop2")
ROBOTS_OF_CAMPAIGNS = (pytest.param("trirack2", marks=pytest.mark.campaign),)
ROWS = 24
LOAD = (0.02, -0.03, -0.04)
#: Answers to redundant tasks are settled to 1e-7 bar; out of reach they are found to about 2e-6 bar.
SETTLED_PA = 0.2
RESIDUAL_M = 1e-10


@pytest.fixture(scope="module", params=[*ROBOTS, *ROBOTS_OF_CAMPAIGNS])
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
    for row, actuation in zip(found, actuations.tolist(), strict=True):
        pose = model.forward(tuple(actuation), load)
        assert tuple(row["tip_m"].tolist()) == pose.tip_m
        assert tuple(row["rotation"].ravel().tolist()) == tuple(pose.rotation)
        assert tuple(row["direction"].tolist()) == pose.direction
        assert tuple(row["mid_m"].tolist()) == pose.mid_m
        assert row["stable"] == pose.stable


@pytest.mark.parametrize("load", [ZERO3, LOAD])
def test_forward(model: Model, load: tuple[float, float, float]) -> None:
    assert_same_poses(model, box(model), load)


def assert_same_answers(
    model: Model, targets: Targets, seeds: np.ndarray, chained: bool, threads: int
) -> None:
    found = inverse_many(model, targets, seeds, chained=chained, threads=threads)
    last = tuple(seeds[0].tolist())
    for k in range(len(targets)):
        if not chained and len(seeds) > 1:
            last = tuple(seeds[k].tolist())
        single = model.inverse(target_of(targets, k), last)
        row = found.rows[k]
        assert row["converged"] == single.converged
        if isinstance(model, CosseratModel) and targets.load_n is None and not chained:
            assert np.isfinite(row["residual_m"]) == np.isfinite(single.residual_m)
            if np.isfinite(single.residual_m):
                np.testing.assert_allclose(row["residual_m"], single.residual_m, rtol=1e-9, atol=RESIDUAL_M)
            if not targets.tip_m[k, :2].any():
                continue  # on the axis: rounding chooses between answers that are as good
            np.testing.assert_allclose(row["actuation"], single.actuation, rtol=0.0, atol=SETTLED_PA)
        else:
            assert tuple(row["actuation"].tolist()) == single.actuation, k
            assert np.array_equal(row["residual_m"], single.residual_m, equal_nan=True)
            assert row["iterations"] == single.iterations
        assert sorted(found.limited_by(k)) == sorted(single.limited_by)
        if chained:
            last = single.actuation


@pytest.mark.parametrize("chained", [False, True])
def test_tips_from_one_seed(model: Model, chained: bool) -> None:
    assert_same_answers(model, Targets.of(reached(model)), box(model, 1), chained, 2)


@pytest.mark.slow
def test_loaded_tips_with_a_seed_each(model: Model) -> None:
    # A search under load takes long, of two sections most; those of one use every lane of a block again.
    rows = 12 if len(model.axis_names) < 6 else 4
    assert_same_answers(model, Targets.of(reached(model, rows), load_n=LOAD), box(model, rows), False, 3)


@pytest.mark.parametrize("row", ["direction", "mid"])
def test_tips_and_more(model: Model, row: str) -> None:
    if len(model.axis_names) != 6 or isinstance(model, PhModel):
        pytest.skip("needs two sections")
    poses = [model.forward(tuple(actuation)) for actuation in box(model).tolist()]
    tips = [pose.tip_m for pose in poses]
    mids, directions = [pose.mid_m for pose in poses], [pose.direction for pose in poses]
    targets = Targets.of(tips, directions) if row == "direction" else Targets.of(tips, mid_m=mids)
    assert_same_answers(model, targets, box(model, 1), False, 2)


@pytest.mark.parametrize("model", ["trirack"], indirect=True)
def test_a_direction_that_one_section_cannot_meet_is_limited_by_reach(model: Model) -> None:
    poses = [model.forward(tuple(actuation)) for actuation in box(model).tolist()]
    targets = Targets.of(
        [pose.tip_m for pose in poses], np.roll([pose.direction for pose in poses], 1, axis=0)
    )
    found = inverse_many(model, targets, box(model, 1))
    away = np.flatnonzero(~found.rows["converged"]).tolist()
    assert len(away) > ROWS / 2
    assert all(found.limited_by(k) for k in away)
    assert any(found.limited_by(k) == ("reach",) for k in away)
    assert_same_answers(model, targets, box(model, 1), False, 2)


def test_tips_that_are_no_numbers(model: Model) -> None:
    tips = reached(model, 4)
    tips[1], tips[2], tips[3] = np.nan, np.inf, 0.0
    assert_same_answers(model, Targets.of(tips), box(model, 1), False, 1)


@pytest.mark.parametrize("chained", [False, True])
def test_tips_too_far_to_compute_with(model: Model, chained: bool) -> None:
    tips = reached(model, 4)
    tips[0] *= 1e9
    tips[2] *= 1e307
    assert_same_answers(model, Targets.of(tips), box(model, 1), chained, 2)


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
    assert len(inverse_many(model, Targets.of(np.empty((0, 3))), np.zeros(axes)).rows) == 0


@pytest.mark.parametrize("model", ["finger"], indirect=True)
@pytest.mark.parametrize("rows", [pytest.param(3000, marks=pytest.mark.campaign), 600])
def test_tips_of_all_sizes_of_a_finger(model: Model, rows: int) -> None:
    """The kernel's hypot rounds as Python's, also for tips next to the axis and next to the base."""
    rng = np.random.default_rng(17)
    low, high = np.array(model.lower), np.array(model.upper)
    tips = forward_many(model, low + rng.random((rows, 2)) * (high - low))["tip_m"]
    tips[::3, 0] *= 10.0 ** rng.uniform(-300.0, 0.0, rows // 3)
    assert_same_answers(model, Targets.of(tips), box(model, 1), False, 2)


def test_the_number_of_threads_changes_nothing(model: Model) -> None:
    tips = Targets.of(reached(model, 80))
    one, many = (inverse_many(model, tips, box(model, 1), threads=count) for count in (1, 7))
    assert one.rows.tobytes() == many.rows.tobytes()
