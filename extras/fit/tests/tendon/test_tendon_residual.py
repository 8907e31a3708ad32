"""The correction of the tip from a calibration: bounded, faded, with an exact derivative, met by answers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contid.errors import BadInputError
from contid.kinematics.tendon.model import TendonModel
from contid.kinematics.tendon.residual import TipCorrection
from contid.robot_file.edit import Change, edited
from contid.robot_file.load import parse_robot_file
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Target
from contid_fit.calibrate.tendon.residual import Residual, fit_residual
from contid_tendons.loaded import LoadedTendonModel
from tests.kinematics.tendon_robots import random_bends, shipped

BENDS, FEATURES, TERMS = 6, 15, 37


def described(seed: int = 1, size_mm: float = 0.6) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    return {
        "low_rad_mm": [-0.8] * BENDS + [-0.05] * 9,
        "high_rad_mm": [0.8] * BENDS + [0.6] * 9,
        **{f"gain_{axis}_mm": rng.normal(0.0, size_mm, TERMS).tolist() for axis in "xyz"},
        "bound_mm": 4.0,
    }


def text_of(configs: Path, residual: dict[str, Any]) -> str:
    raw = yaml.safe_load((configs / "tendon3.yaml").read_text())
    raw["robots"]["arm"]["residual"] = residual
    return yaml.safe_dump(raw, sort_keys=False, default_flow_style=None)


def model_of(configs: Path, residual: dict[str, Any]) -> TendonModel:
    (robot,) = parse_robot_file(text_of(configs, residual), "t.yaml").file.robots.values()
    assert isinstance(robot, TendonRobot)
    return TendonModel(robot)


def taut_pulls(share: float, count: int, seed: int) -> np.ndarray:
    plain = shipped()
    assert plain.statics is not None
    return np.array([plain.statics.pulls(share * bends) for bends in random_bends(plain, count, seed)])


def test_the_tip_moves_by_the_correction_and_no_further(configs: Path) -> None:
    model, plain = model_of(configs, described()), shipped()
    for pulls in taut_pulls(1.0, 40, seed=3):
        here, without = model.forward(tuple(pulls)), plain.forward(tuple(pulls))
        moved = np.linalg.norm(np.subtract(here.tip_m, without.tip_m))
        assert moved <= 4e-3 + 1e-12
        assert here.rotation == without.rotation
        assert here.mid_m == without.mid_m


def test_outside_the_data_it_fades_to_nothing(configs: Path) -> None:
    narrow = described() | {"low_rad_mm": [-0.01] * 15, "high_rad_mm": [0.01] * 15}
    model, plain = model_of(configs, narrow), shipped()
    pulls = tuple(taut_pulls(0.9, 1, seed=5)[0].tolist())
    np.testing.assert_allclose(model.forward(pulls).tip_m, plain.forward(pulls).tip_m, atol=1e-12)


@pytest.mark.parametrize("bound_mm", [4.0, 0.3])
def test_the_jacobian_is_that_of_differences(configs: Path, bound_mm: float) -> None:
    model = model_of(configs, described() | {"bound_mm": bound_mm})
    for pulls in taut_pulls(0.8, 8, seed=7):
        jacobian = model.jacobian(tuple(pulls))
        for tendon in range(9):
            step = np.zeros(9)
            step[tendon] = 1e-7
            up, down = (model.forward(tuple(pulls + sign * step)).tip_m for sign in (1, -1))
            np.testing.assert_allclose(jacobian[:, tendon], np.subtract(up, down) / 2e-7, atol=1e-4)


def test_answers_meet_their_targets_and_stay_taut(configs: Path) -> None:
    model = model_of(configs, described(size_mm=0.3))
    assert model.statics is not None
    seed = (0.0,) * 9
    for case, pulls in enumerate(taut_pulls(0.7, 30, seed=9)):
        pose = model.forward(tuple(pulls))
        target = Target(tip_m=pose.tip_m, direction=pose.direction if case % 2 else None)
        answer = model.inverse(target, seed)
        assert answer.converged, answer.note
        assert model.forward(answer.actuation).tip_m == pytest.approx(pose.tip_m, abs=1e-6)
        assert np.min(model.statics.tensions(np.array(answer.actuation))) >= model.statics.floor_n - 1e-6
        again = model.inverse(target, answer.actuation)
        assert again.actuation == pytest.approx(answer.actuation, abs=1e-6)


def test_an_answer_asked_again_from_itself_takes_one_solve(configs: Path) -> None:
    model = model_of(configs, described(size_mm=0.3))
    target = Target(tip_m=model.forward(tuple(taut_pulls(0.7, 1, seed=9)[0])).tip_m)
    seed = model.inverse(target, (0.0,) * 9).actuation
    seed = model.inverse(target, seed).actuation
    solves, kernel = 0, model.solver

    class Counting:
        def __getattr__(self, name: str) -> Any:
            nonlocal solves
            solves += name == "solve"
            return getattr(kernel, name)

    model.solver = Counting()
    assert model.inverse(target, seed).converged
    assert solves == 1


def test_a_target_out_of_reach_leaves_a_residual(configs: Path) -> None:
    model = model_of(configs, described())
    answer = model.inverse(Target(tip_m=(0.0, 0.0, 1.0)), (0.0,) * 9)
    assert not answer.converged
    assert answer.limited_by


def test_it_is_the_correction_of_the_fit() -> None:
    """Written by the calibration, read by the model: what the ridge regression of the fit computes."""
    plain, rng = shipped(), np.random.default_rng(11)
    assert plain.statics is not None
    pulls = taut_pulls(0.7, 240, seed=13)
    slack_m = rng.uniform(0.0, 2e-4, 9)
    bends = pulls @ plain.statics.bends_by_pulls.T
    stretch = pulls - bends @ plain.geometry.pull_matrix.T + slack_m
    features = np.hstack((bends, stretch))
    missing = 2e-3 * np.stack((bends[:, 0] * bends[:, 1], np.sin(bends[:, 2]), bends[:, 4] ** 2), axis=1)
    runs = np.floor(np.arange(240.0) / 20.0)
    residual = fit_residual(features, missing, runs, BENDS)
    assert np.isfinite(residual.penalty)  # a residual that is there is accepted
    read = TipCorrection.of(written(residual, slack_m), plain.statics)
    for row in (*pulls, *taut_pulls(1.0, 20, seed=15)):
        bent = plain.statics.bends_by_pulls @ row
        given = np.concatenate((bent, row - plain.geometry.pull_matrix @ bent + slack_m))
        np.testing.assert_allclose(read.at(row), residual.correction(given[None])[0], atol=1e-8)
    left = [np.linalg.norm(read.at(row) - error) for row, error in zip(pulls, missing, strict=True)]
    assert np.mean(left) < 0.3 * np.mean(np.linalg.norm(missing, axis=1))


def written(residual: Residual, slack_m: np.ndarray) -> Any:
    """As the calibration writes it, through the file's own description."""
    from types import SimpleNamespace

    from contid.robot_file.tendon.statics import TendonResidual
    from contid_fit.calibrate.tendon.result import residual_of

    parameters = SimpleNamespace(split=lambda vector: {"offset_m": slack_m})
    fit = SimpleNamespace(model=SimpleNamespace(parameters=parameters), vector=None)
    found = residual_of(SimpleNamespace(residual=residual, fit=fit))  # type: ignore[arg-type]  # what it reads
    assert found is not None
    return TendonResidual.model_validate(found)


def test_a_calibration_writes_it_into_the_file(configs: Path) -> None:
    text = (configs / "tendon3.yaml").read_text()
    change = Change("robots.arm.residual", described(), "from recording.csv")
    once = edited(text, [change])
    assert "# from recording.csv" in once
    assert edited(once, [change]) == once
    (robot,) = parse_robot_file(once, "t.yaml").file.robots.values()
    assert isinstance(robot, TendonRobot)
    pulls = tuple(taut_pulls(0.5, 1, seed=17)[0].tolist())
    assert TendonModel(robot).forward(pulls) == model_of(configs, described()).forward(pulls)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gain_x_mm": [0.0]}, "residual.gain_x_mm has 1 numbers; allowed: 37"),
        ({"low_rad_mm": [2.0] * 15}, "range 2 to 0.8 is empty"),
        ({"bound_mm": -1.0}, "bound_mm"),
    ],
)
def test_wrong_corrections_are_refused(configs: Path, change: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInputError) as caught:
        parse_robot_file(text_of(configs, described() | change), "t.yaml")
    assert message in str(caught.value)


def rod_of(configs: Path, residual: dict[str, Any] | None) -> LoadedTendonModel:
    raw = yaml.safe_load((configs / "tendon3.yaml").read_text())
    raw["robots"]["arm"]["rod"] = {"weight_n_per_m": [0.8], "elements": 4}
    if residual is not None:
        raw["robots"]["arm"]["residual"] = residual
    text = yaml.safe_dump(raw, sort_keys=False, default_flow_style=None)
    (robot,) = parse_robot_file(text, "t.yaml").file.robots.values()
    assert isinstance(robot, TendonRobot)
    return LoadedTendonModel(robot)


def test_a_rod_s_tip_is_corrected_and_met_under_its_load(configs: Path) -> None:
    """The plain rod and the correction by itself are the oracle; answers keep every tendon taut."""
    model, plain = rod_of(configs, described(size_mm=0.3)), rod_of(configs, None)
    arcs = model_of(configs, described(size_mm=0.3))
    load_n = (0.02, -0.01, 0.0)
    for pulls in taut_pulls(0.4, 6, seed=8):
        here = tuple(pulls.tolist())
        pose = model.forward(here, load_n)
        moved = np.subtract(pose.tip_m, plain.forward(here, load_n).tip_m)
        by_arcs = np.subtract(arcs.forward(here).tip_m, shipped().forward(here).tip_m)
        np.testing.assert_allclose(moved, by_arcs, atol=1e-12)
        assert np.linalg.norm(moved) > 1e-5
        answer = model.inverse(Target(tip_m=pose.tip_m, direction=pose.direction, load_n=load_n), (0.0,) * 9)
        assert answer.converged
        assert np.abs(np.subtract(model.forward(answer.actuation, load_n).tip_m, pose.tip_m)).max() < 1e-7
        assert model.statics is not None
        tensions = model.equilibrium(answer.actuation, load_n).tensions_n
        assert np.min(tensions) >= model.statics.floor_n - 1e-5
        np.testing.assert_allclose(model.shape(here, 12, load_n)[-1], pose.tip_m, atol=1e-9)


def test_the_jacobian_of_a_corrected_rod_is_exact(configs: Path) -> None:
    model = rod_of(configs, described(size_mm=0.3))
    (pulls,) = taut_pulls(0.4, 1, seed=9)
    jacobian = model.jacobian(tuple(pulls.tolist()))
    for k in range(9):
        step = np.zeros(9)
        step[k] = 1e-6
        ends = [np.array(model.forward(tuple((pulls + side * step).tolist())).tip_m) for side in (1.0, -1.0)]
        np.testing.assert_allclose(jacobian[:, k], (ends[0] - ends[1]) / 2e-6, atol=1e-5)
