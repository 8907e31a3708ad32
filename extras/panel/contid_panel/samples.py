"""Actuations of a robot, their tips in the world frame, and points as pages get them."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Final

import numpy as np

from contid.control.tick.config import RobotConfig
from contid.kinematics.array import Array
from contid.targets import Actuation, Target
from contid.units import MM_PER_M
from contid_view.robot_scene import RobotScene

#: Random actuations whose tips show the reach of a spatial arm; always the same ones.
REACH_TIPS: Final = 500
#: Decimals of coordinates [mm].
DECIMALS: Final = 2


def actuation_of(robot: RobotScene, values: Sequence[float]) -> Actuation:
    """Values of the axes in their units, as telemetry has them, in m or Pa."""
    return tuple(value / each.per_si for value, each in zip(values, robot.config.quantities, strict=True))


def values_of(config: RobotConfig, actuation: Sequence[float]) -> list[float]:
    """The same in the units of files; also of rates."""
    return [value * each.per_si for value, each in zip(actuation, config.quantities, strict=True)]


def inside(config: RobotConfig, actuation: Actuation) -> Actuation:
    """The nearest actuation within the limits that couple axes."""
    own = len(config.axis_names) - config.extra_axes
    return config.model.inverse(Target(actuation=actuation[:own]), actuation).actuation


def drawn(robot: RobotScene) -> list[Actuation]:
    """Random actuations within the limits, always the same ones."""
    numbers, model = random.Random(1), robot.config.model
    limits = list(zip(model.lower, model.upper, strict=True))
    return [tuple(numbers.uniform(*each) for each in limits) for _ in range(REACH_TIPS)]


def tip_mm(robot: RobotScene, actuation: Actuation) -> Array | None:
    """The tip in the world frame [mm]; None outside the domain of the model."""
    try:
        tip = robot.config.model.forward(actuation).tip_m
    except (ValueError, ArithmeticError):
        return None
    found: Array = np.array(robot.config.frame.point_in_world(tip)) * MM_PER_M
    return found if np.isfinite(found).all() else None


def rounded_line(points: Array) -> list[list[float]]:
    """Points as lists, rounded."""
    rounded: list[list[float]] = points.round(DECIMALS).tolist()
    return rounded
