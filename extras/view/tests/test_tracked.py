"""The measured shape follows the backbone of the plant, independently of the model."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from contid.control.engine.tick_layout import RobotRecord
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.robot_file.load import load_robot_file
from contid.targets import Target, Vec3
from contid_ropes.body_shape import by_model
from contid_view.measured_shape import POINTS, measured_shape

#: A posture each: actuation as a fraction of every axis's range, and the allowed distance of the curve from
#: the backbone, as a fraction of its length.
ROBOTS = {
    "finger": ((0.45, 0.60), 0.03),
    "cbha": ((0.3, 0.5, 0.6, 0.6, 0.4, 0.5), 0.02),
    "trirack": ((0.40, 0.50, 0.45), 0.01),
    "stiffflop1": ((0.3, 0.1, 0.0), 0.01),
    "stiffflop2": ((0.3, 0.1, 0.0, 0.2, 0.1, 0.0), 0.04),
    "chain": ((0.3, 0.5, 0.6, 0.6, 0.4, 0.5), 0.02),
}


def config_of(configs: Path, name: str) -> RobotConfig:
    return build_robot_configs(load_robot_file(configs / f"{name}.yaml"), 200.0)[0]


NAN3 = (math.nan,) * 3


def tracked(tip: Vec3, direction: Vec3 = NAN3) -> RobotRecord:
    nothing = math.nan
    return RobotRecord(
        0, 0, 0, 0, 0, NAN3, NAN3, NAN3, NAN3, nothing, nothing, tip, direction, 0.0, NAN3, NAN3, NAN3, ()
    )


@pytest.mark.parametrize("name", ROBOTS)
def test_it_follows_the_backbone_of_the_plant(name: str, configs: Path) -> None:
    shares, allowed = ROBOTS[name]
    config = config_of(configs, name)
    model = config.model
    wish = [a + s * (b - a) for a, b, s in zip(model.lower, model.upper, shares, strict=False)]
    actuation = model.inverse(Target(actuation=tuple(wish)), config.rest).actuation
    backbone = by_model(model, config.frame, actuation, POINTS)
    length_mm = 1e3 * backbone.length_m
    # The length from the samples of the actuators is accurate to 1 %.
    for given_mm in (0.99 * length_mm, length_mm, 1.01 * length_mm):
        found = measured_shape(config, tracked(*backbone.tip), given_mm)
        assert found is not None
        assert found.line is not None
        assert found.line[0] == pytest.approx(1e3 * np.array(config.frame.origin_in_world), abs=1e-9)
        assert found.line[-1] == pytest.approx(found.tip[0], abs=1e-9)
        off = np.max(np.linalg.norm(found.line - 1e3 * backbone.points_in_world, axis=1)) / length_mm
        assert off < allowed + 0.04 * (given_mm != length_mm)


def test_a_straight_arm_with_too_long_a_length_stays_straight(configs: Path) -> None:
    config = config_of(configs, "trirack")
    backbone = by_model(config.model, config.frame, config.rest, POINTS)
    found = measured_shape(config, tracked(*backbone.tip), 1.01e3 * backbone.length_m)
    assert found is not None
    assert found.line is not None
    assert found.line == pytest.approx(1e3 * backbone.points_in_world, abs=1e-6)


def test_without_a_direction_only_the_tip_and_without_a_tip_nothing(configs: Path) -> None:
    config = config_of(configs, "cbha")
    assert measured_shape(config, tracked(NAN3), None) is None
    only_tip = measured_shape(config, tracked((0.01, 0.02, 0.2)), 230.0)
    assert only_tip is not None
    assert only_tip.line is None
    assert only_tip.tip.tolist() == [pytest.approx([10.0, 20.0, 200.0])]
    at_its_base = measured_shape(config, tracked(config.frame.origin_in_world, (0.0, 0.0, 1.0)), 230.0)
    assert at_its_base is not None
    assert at_its_base.line is None


def test_any_pose_gives_a_finite_curve(configs: Path) -> None:
    rng = np.random.default_rng(3)
    for name in ("finger", "cbha"):
        config = config_of(configs, name)
        for _ in range(30):
            tip, direction = rng.normal(size=3) * 0.1, rng.normal(size=3)
            direction = -tip if rng.random() < 0.2 else direction
            if config.model.dimension == 2:
                tip[2] = direction[2] = 0.0
            direction /= np.linalg.norm(direction)
            for length_mm in (None, 5.0, 100.0, 1000.0):
                found = measured_shape(config, tracked(tuple(tip), tuple(direction)), length_mm)
                assert found is not None
                assert found.line is not None
                assert np.isfinite(found.line).all()
