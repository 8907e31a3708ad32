"""Arms of five to eight sections from a robot file: forward against matrix exponentials, inverse, batches."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.linalg import expm

from contid.kinematics.arc.section_model import SectionModel
from contid.kinematics.batch import Targets, forward_many, inverse_many
from contid.kinematics.cosserat.engine import RodSolver
from contid.kinematics.cosserat.model import CosseratModel
from contid.kinematics.model import build_model
from contid.robot_file.document import RobotFile
from contid.targets import Target
from tests.oracles.rod_equations import integrate

CONFIGS = Path(__file__).parents[2] / "configs"
COUNTS = (5, 6, 7, 8)
AZIMUTHS = (math.pi, math.pi / 3, -math.pi / 3)


def shipped(name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    raw = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text())
    (robot,) = raw["robots"].values()
    for key in ("placeholder", "rest_mm", "extra_mm"):
        robot.pop(key, None)
    return raw, robot


def axes(robot: dict[str, Any], letter: str, count: int) -> None:
    """The first axis of the robot, once for each of so many sections, on a board for every twelve."""
    first = robot["axes"][f"s1.{letter}1"]
    names = [f"s{s + 1}.{letter}{j + 1}" for s in range(count) for j in range(3)]
    robot["axes"] = {
        name: {**copy.deepcopy(first), "bus": f"board{k // 12}", "channel": f"p{k % 12}"}
        for k, name in enumerate(names)
    }


def boards(raw: dict[str, Any], count: int) -> None:
    (board, *_) = raw["buses"].values()
    raw["buses"] = {f"board{k}": {**board, "port": f"/dev/board{k}"} for k in range((3 * count + 11) // 12)}


def tubes(count: int) -> SectionModel:
    raw, robot = shipped("cbha")
    robot["geometry"]["radius_mm"] = [40.0 - 3.0 * s for s in range(count)]
    robot["limits"]["length_mm"] = [[60, 110]] * count
    axes(robot, "l", count)
    boards(raw, count)
    (described,) = RobotFile.model_validate(raw).robots.values()
    model = build_model(described)
    assert isinstance(model, SectionModel)
    return model


def pneumatic(count: int) -> CosseratModel:
    raw, robot = shipped("stiffflop2")
    first, second = robot["geometry"]["sections"]
    robot["geometry"]["sections"] = [first] * (count - 1) + [second]
    axes(robot, "p", count)
    boards(raw, count)
    (described,) = RobotFile.model_validate(raw).robots.values()
    model = build_model(described)
    assert isinstance(model, CosseratModel)
    return model


def tip_by_exponentials(model: SectionModel, lengths: np.ndarray) -> np.ndarray:
    """Product of exp of the twists of constant curvature, without the formulae of arcs."""
    frame = np.eye(4)
    for s, radius in enumerate(model.sections.radius_m):
        rows = [[-radius * math.cos(a), -radius * math.sin(a), 1.0] for a in AZIMUTHS]
        u, v, length = np.linalg.solve(rows, lengths[3 * s : 3 * s + 3])
        # Bending by the angle hypot(u, v) towards (u, v): the rotation vector is e_z x (u, v).
        twist = np.array([[0, 0, u, 0], [0, 0, v, 0], [-u, -v, 0, length], [0, 0, 0, 0]])
        frame = frame @ expm(twist)
    return np.asarray(frame[:3, 3])


def inside(model: SectionModel | CosseratModel, rows: int) -> np.ndarray:
    low, high = np.array(model.lower), np.array(model.upper)
    share: np.ndarray = np.random.default_rng(8).random((rows, len(low)))
    return np.asarray(low + share * (high - low))


@pytest.mark.parametrize("count", COUNTS)
def test_forward_is_the_product_of_exponentials(count: int) -> None:
    model = tubes(count)
    for lengths in inside(model, 3):
        expected = tip_by_exponentials(model, lengths)
        assert model.forward(tuple(lengths.tolist())).tip_m == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("directed", [False, True])
def test_targets_of_other_postures_are_met_within_the_limits(count: int, directed: bool) -> None:
    model = tubes(count)
    postures = inside(model, 6)
    tips = [tip_by_exponentials(model, lengths) for lengths in postures]
    directions = [model.forward(tuple(lengths.tolist())).direction for lengths in postures]
    targets = Targets.of(tips, directions if directed else None)
    found = inverse_many(model, targets, 0.5 * (np.array(model.lower) + np.array(model.upper)))
    assert found.rows["converged"].all()
    for tip, lengths in zip(tips, found.rows["actuation"], strict=True):
        assert tip_by_exponentials(model, lengths) == pytest.approx(tip, abs=2e-6)
        assert float(np.max(model.feasible.excess(lengths))) <= 1e-12


@pytest.mark.parametrize("count", COUNTS)
def test_pneumatic_arms_of_many_sections_stand_by_the_equations(count: int) -> None:
    model = pneumatic(count)
    fine = RodSolver(replace(model.setup, elements=32))
    pressures, force = inside(model, 1)[0] / 1e5, (0.0, 0.002, 0.003)
    found = fine.forward(pressures.tolist(), force)
    assert found.stable
    loads = model.setup.loads(force)
    exact = integrate(model.setup.rod, pressures, loads, np.array(found.base_moment_nmm))
    assert np.abs(exact.left).max() < 1e-4
    assert found.tip_mm == pytest.approx(exact.tip, abs=1e-3)
    assert found.mid_mm == pytest.approx(exact.ends[0], abs=1e-4)
    assert found.rotation == pytest.approx(exact.rotation.ravel(), abs=1e-5)


@pytest.mark.parametrize("count", [5, 8])
def test_pneumatic_tips_are_met(count: int) -> None:
    model = pneumatic(count)
    tips = forward_many(model, inside(model, 10))["tip_m"]
    middle = tuple(0.5 * (low + high) for low, high in zip(model.lower, model.upper, strict=True))
    for tip in tips.tolist():
        found = model.inverse(Target(tip_m=tuple(tip)), middle)
        assert found.converged
        assert math.dist(model.forward(found.actuation).tip_m, tip) <= 1e-6
