"""Configurations of shipped robots for tests of single ticks."""

from __future__ import annotations

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.robot_file.load import with_mock
from contid.robot_file.shipped import load_named

RATE = 100.0
#: Limits may be exceeded by rounding.
SLACK = 1.0 + 1e-6


def config_of(name: str) -> RobotConfig:
    (config,) = build_robot_configs(with_mock(load_named(name)), RATE)
    return config
