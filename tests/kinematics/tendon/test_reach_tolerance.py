"""`reach_tolerance_mm`: tips that are missed by a little count as met, in single calls and in batches."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from contid.kinematics.any_target import any_target, tolerate
from contid.kinematics.batch import Targets, inverse_many
from contid.kinematics.model import Model, build_model, build_model_for_ticks
from contid.robot_file.load import load_named, parse_robot_file
from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation, Solution, Target


def robot_of(name: str, tolerance: str) -> RobotDescription:
    text = Path(load_named(name).path).read_text()
    first = next(line for line in text.splitlines() if line.strip().startswith("model: "))
    indent = first[: len(first) - len(first.lstrip())]
    changed = text.replace(first, f"{first}\n{indent}{tolerance}", 1) if tolerance else text
    return next(iter(parse_robot_file(changed, "robot.yaml").file.robots.values()))


@pytest.mark.parametrize("name", ["tendon3", "trirack", "finger", "stiffflop1"])
def test_a_tip_that_is_missed_by_less_counts_as_met(name: str) -> None:
    plain = robot_of(name, "")
    tolerant = robot_of(name, "reach_tolerance_mm: 2")

    def missed(model: Model, robot: RobotDescription, by_m: float) -> tuple[bool, float]:
        axes = len(model.axis_names)
        pose = model.forward(robot.upper[:axes] if name != "tendon3" else robot.rest[:axes])
        x, y, z = (p + by_m * d for p, d in zip(pose.tip_m, pose.direction, strict=True))
        found = model.inverse(Target(tip_m=(x, y, z)), robot.rest[:axes])
        batch = inverse_many(model, Targets.of([[x, y, z]]), robot.rest[:axes]).rows
        assert bool(batch["converged"][0]) == found.converged
        return found.converged, found.residual_m

    assert missed(build_model(plain), plain, 0.0015)[0] is False
    for model in (build_model(tolerant), build_model_for_ticks(tolerant)):
        met, residual_m = missed(model, tolerant, 0.0015)
        assert met
        assert residual_m == pytest.approx(0.0015, rel=0.05)
        assert missed(model, tolerant, 0.003)[0] is False


def test_axes_beyond_their_limits_are_not_met_by_it() -> None:
    robot = robot_of("trirack", "reach_tolerance_mm: 2")
    found = build_model(robot).inverse(Target(actuation=(0.0499, 0.0499, 0.0499)), robot.rest)
    assert not found.converged


def test_an_error_that_is_no_number_is_not_met() -> None:
    class Lost:
        @any_target  # type: ignore[type-var]
        def inverse(self, target: Target, seed: Actuation) -> Solution:
            return Solution(seed, math.nan, converged=False, limited_by=("reach",))

    for tolerance_m in (None, 0.002):
        model: Any = Lost()
        if tolerance_m is not None:
            tolerate(model, tolerance_m)
        assert not model.inverse(Target(tip_m=(0.0, 0.0, 0.1)), (0.0,)).converged
