"""Configurations of shipped robots for tests of single ticks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.robot_file.load import load_named, with_mock
from contid.targets import Actuation, Target, Vec3

RATE = 100.0
#: Limits may be exceeded by rounding.
SLACK = 1.0 + 1e-6
#: Shipped robots of each family: racks, tubes with an extra axis and in a chain, chambers, tendons of one
#: section and of three.
FAMILIES = ("catheter", "cbha", "chain", "finger", "hand", "stiffflop2", "tendon3", "trirack2")


def one_of_each_family(names: Iterable[str]) -> list[Any]:
    """Parameters of a test of shipped robots: CI tries those of `FAMILIES`, campaigns the others too."""
    return [pytest.param(name, marks=() if name in FAMILIES else pytest.mark.campaign) for name in names]


def config_of(name: str) -> RobotConfig:
    (config,) = build_robot_configs(with_mock(load_named(name)), RATE)
    return config


def postures(
    config: RobotConfig, rng: np.random.Generator, low: float, high: float, spread: float = 0.05
) -> tuple[Actuation, Vec3]:
    """A settled start and the tip of another posture, with every axis between shares of its travel."""
    model = config.model
    least, travel = np.array(model.lower), np.array(model.upper) - np.array(model.lower)
    travel[len(travel) - config.extra_axes :] = 0.0
    least[len(travel) - config.extra_axes :] = 0.0
    ends = []
    for _ in range(2):
        middle = rng.uniform(low, high)
        share = np.clip(middle + rng.uniform(-spread, spread, len(least)), 0.02, 0.98)
        requested = tuple((least + share * travel).tolist())
        own = requested[: len(requested) - config.extra_axes]
        ends.append(model.inverse(Target(actuation=own), requested).actuation)
    start = model.inverse(Target(tip_m=model.forward(ends[0]).tip_m), ends[0]).actuation
    return start, model.forward(ends[1]).tip_m
