"""The weight of a robot acts along one ``down`` of the world, in every model and on every base."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contid.kinematics.array import Array
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import build_model
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Actuation
from contid.units import BAR

#: Bases as they are mounted: on a table, from a ceiling, on a wall, on a slope; the last one mirrored.
BASES: tuple[dict[str, Any], ...] = (
    {"z_mm": 400},
    {"z_mm": 500, "roll_deg": 180},
    {"pitch_deg": 90},
    {"x_mm": 30, "roll_deg": 35, "pitch_deg": -20, "yaw_deg": 70},
    {"roll_deg": 110, "yaw_deg": 15, "mirror_x": True},
)
PULLS = (0.005, -0.0025, -0.0025, 0.008, -0.003, -0.005, 0.008, -0.004, -0.004)
PRESSURES = tuple(x * BAR for x in (0.3, 0.9, 0.1, 0.6, 0.0, 0.7))


def describe(configs: Path, name: str, **changes: Any) -> RobotDescription:
    robot = yaml.safe_load((configs / f"{name}.yaml").read_text(encoding="utf-8"))["robots"]["arm"]
    return (TendonRobot if robot["model"] == "tendon" else Cosserat).model_validate({**robot, **changes})


def arm_of(configs: Path, model: str, **keys: Any) -> tuple[RobotDescription, Actuation]:
    """An arm that has weight, with a bent actuation."""
    if model == "tendon":
        return describe(configs, "tendon3", rod={"weight_n_per_m": [2.0]}, **keys), PULLS
    geometry = describe(configs, "stiffflop2").model_dump()["geometry"]
    for section in geometry["sections"]:
        section["density_kg_m3"] = 1070.0
    return describe(configs, "stiffflop2", geometry=geometry, **keys), PRESSURES


def tip_in_base(robot: RobotDescription, actuation: Actuation) -> Array:
    return np.array(build_model(robot).forward(actuation).tip_m)


@pytest.mark.parametrize("model", ["tendon", "cosserat"])
@pytest.mark.parametrize("base", BASES)
def test_the_weight_of_the_arm_acts_as_the_same_force_stated_in_the_world(
    configs: Path, model: str, base: dict[str, Any]
) -> None:
    """A small weight moves the tip as small loads in the world do: down, by a positive compliance."""
    robot, actuation = arm_of(configs, model, base=base, down=[0, 0, -1])
    light = tip_in_base(_without_weight(configs, model, base), actuation)
    sag = BaseFrame.of(robot.base).vector_in_world(tuple(tip_in_base(robot, actuation) - light))
    assert sag[2] < -1e-3 * math.hypot(*sag)


@pytest.mark.parametrize("model", ["tendon", "cosserat"])
@pytest.mark.parametrize("base", BASES)
def test_turning_the_world_with_the_robot_changes_nothing(
    configs: Path, model: str, base: dict[str, Any]
) -> None:
    turned, actuation = arm_of(configs, model, base=base, down=[0, 0, -1])
    down = BaseFrame.of(turned.base).vector_in_base((0.0, 0.0, -1.0))
    upright, _ = arm_of(configs, model, down=list(down))
    np.testing.assert_allclose(tip_in_base(turned, actuation), tip_in_base(upright, actuation), atol=1e-12)


def test_a_rod_on_a_wall_sags_as_the_beam_of_euler(configs: Path) -> None:
    """With slack of the tendons out of the way, the end of a cantilever sags by w L^4 / 8 EI."""
    weight_n_per_m, bending_n_m2, length_m = 0.05, 2945e-6, 0.3
    described: dict[str, Any] = {
        "tension": {"floor_n": 1e-6, "max_n": 25, "bending_n_mm2": [2945], "tendon_n_per_mm": [1e-6]},
        "base": {"pitch_deg": 90},
    }
    sections = [{"length_mm": 100, "radius_mm": [8], "angles_deg": [0, 120, 240]} for _ in range(3)]
    described["geometry"] = {"sections": sections}
    robot = describe(
        configs, "tendon3", rod={"weight_n_per_m": [weight_n_per_m], "elements": 32}, **described
    )
    x, y, z = BaseFrame.of(robot.base).point_in_world(build_model(robot).forward((0.0,) * 9).tip_m)
    assert z == pytest.approx(-weight_n_per_m * length_m**4 / (8.0 * bending_n_m2), rel=0.01)
    assert abs(y) < 1e-9
    assert x == pytest.approx(length_m, rel=0.01)


def _without_weight(configs: Path, model: str, base: dict[str, Any]) -> RobotDescription:
    if model == "tendon":
        return describe(configs, "tendon3", rod={"weight_n_per_m": [0.0]}, base=base)
    return describe(configs, "stiffflop2", base=base)
