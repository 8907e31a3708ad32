"""The solver by shape: accuracy on arcs, residual elsewhere, its keys in the robot file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contid.errors import BadInputError
from contid.kinematics.arc.sections import Sections
from contid.kinematics.model import build_model
from contid.robot_file.document import RobotFile
from contid.robot_file.load import load_robot_file
from contid.robot_file.tri_tube import TriTube
from contid.targets import Target
from contid_ropes.ph.model import PhModel, arc_direction
from studies import singh
from studies.arc_chains import forward
from tests.kinematics.section_robots import RACKS, free_solver
from tests.support.command import contid

pytestmark = pytest.mark.process


def by_shape(configs: Path, tolerance_mm: float | None = None, **changed: Any) -> PhModel:
    raw = yaml.safe_load((configs / "cbha.yaml").read_text())
    raw["robots"]["cbha"] |= {"solver": {"method": "ph", "tolerance_mm": tolerance_mm}, **changed}
    model = build_model(RobotFile.model_validate(raw).robots["cbha"])
    assert isinstance(model, PhModel)
    return model


@pytest.fixture
def selected(configs: Path, tmp_path: Path) -> Path:
    """A copy of the shipped file with the other solver."""
    text = (configs / "cbha.yaml").read_text()
    path = tmp_path / "cbha_ph.yaml"
    path.write_text(text.replace("    model: tri_tube\n", "    model: tri_tube\n    solver: {method: ph}\n"))
    return path


def test_the_golden_tips_without_and_with_their_directions(configs: Path) -> None:
    """A single arc is met to 0.05 mm; one quintic for two arcs misses by millimetres and reports it."""
    model = by_shape(configs, tolerance_mm=25)
    golden = singh.golden_trajectory()
    frames = forward(model.sections, golden.lengths_m)
    seed = tuple(model.feasible.home.tolist())
    alone, both = [], []
    for tip, rotation in zip(frames.tip[::4].tolist(), frames.rotation[::4], strict=True):
        alone.append(model.inverse(Target(tip_m=tuple(tip)), seed))
        way = tuple(rotation[:, 2].tolist())
        both.append(model.inverse(Target(tip_m=tuple(tip), direction=way), seed))
    assert all(solution.converged for solution in (*alone, *both))
    assert max(solution.residual_m for solution in alone) < 6e-5
    assert 1e-3 < float(np.mean([solution.residual_m for solution in both])) < 7e-3


def test_a_miss_beyond_what_the_file_allows_is_not_met(configs: Path) -> None:
    golden = singh.golden_trajectory()
    model = by_shape(configs)
    seed = tuple(model.feasible.home.tolist())
    frames = forward(model.sections, golden.lengths_m)
    solutions = [
        model.inverse(Target(tip_m=tuple(tip.tolist()), direction=tuple(way.tolist())), seed)
        for tip, way in zip(frames.tip, frames.rotation[:, :, 2], strict=True)
    ]
    assert {s.converged for s in solutions} == {True, False}
    for solution in solutions:
        assert solution.converged == (solution.residual_m <= 5e-3)
        assert solution.converged or "counts up to 5 mm as met" in solution.note


def test_answers_do_not_depend_on_the_seed(configs: Path) -> None:
    model = by_shape(configs)
    target = Target(tip_m=(0.02, 0.03, 0.24))
    assert model.inverse(target, model.lower) == model.inverse(target, model.upper)


def test_lengths_beyond_their_limits_are_pulled_in_and_named(configs: Path) -> None:
    model = by_shape(configs)
    solution = model.inverse(Target(tip_m=(0.0, 0.0, 0.3)), model.lower)
    assert solution.actuation == pytest.approx(model.upper)
    assert solution.residual_m == pytest.approx(0.010)
    assert not solution.converged
    assert solution.limited_by == tuple(f"{name}.max" for name in model.axis_names)


def test_a_rigid_piece_at_the_tip_is_taken_off_first(configs: Path) -> None:
    geometry = {"radius_mm": [40, 32], "rigid_mm": [0, 30]}
    model = by_shape(configs, geometry=geometry)
    for tip in ((0.02, 0.03, 0.25), (0.0, 0.0, 0.27), (-0.06, 0.01, 0.24)):
        assert model.inverse(Target(tip_m=tip), model.lower).residual_m < 1e-4
        one = free_solver(Sections((0.035,), (RACKS,), (0.030,)))
        rotation = one.forward(one.solve(tip, None, None, (0.3,) * 3).lengths).rotation
        assert arc_direction(tip, 0.030) == pytest.approx(rotation[2::3], abs=1e-12)


def test_the_base_itself_has_no_arc() -> None:
    assert all(math.isnan(value) for value in arc_direction((0.0, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("    solver: {method: ph}\n    geometry:\n      rigid_mm: [5, 0]\n", "after the last section only"),
        ("    solver: {tolerance_mm: 2}\n    geometry:\n", "needs method: ph"),
        ("    solver: {method: newton}\n    geometry:\n", "bounded"),
    ],
    ids=["rigid between", "within without ph", "unknown"],
)
def test_invalid_keys_of_the_robot_file(configs: Path, tmp_path: Path, keys: str, message: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text((configs / "cbha.yaml").read_text().replace("    geometry:\n", keys))
    with pytest.raises(BadInputError, match=message):
        load_robot_file(path)


def test_the_solver_runs_from_the_command(selected: Path) -> None:
    """The whole chain: planned, checked, followed; every row met within what the file allows."""
    robot = load_robot_file(selected).file.robots["cbha"]
    assert isinstance(robot, TriTube)
    assert robot.accepts == {"tip", "direction", "actuation", "arcs"}
    options = ("--size", "60", "--height", "240", "--period", "2", "--rate", "50")
    path = contid("path", "circle", *options, "--for", str(selected))
    assert path.returncode == 0, path.stderr
    done = contid("run", str(selected), "--mock", "--virtual", stdin=path.stdout)
    assert done.returncode == 0, done.stderr
    leaning = contid("path", "circle", *options, "--lean", "40", "--for", str(selected))
    refused = contid("run", str(selected), "--mock", "--virtual", stdin=leaning.stdout)
    assert refused.returncode == 2
    assert "solver ph counts up to 5 mm as met" in refused.stderr
