"""Drawn tendons and discs, against lengths that the geometry gives by itself."""

from __future__ import annotations

import numpy as np
import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.load import load_named, with_mock
from contid_view.robot_scene import RobotScene
from contid_view.tendon_lines import CORNERS, DISCS, tendon_lines
from tests.kinematics.tendon_robots import placed, random_bends, shipped


def lengths(lines: list[np.ndarray]) -> np.ndarray:
    return np.array([np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines])


@pytest.mark.parametrize("name", ["tendon3", "ftdcr_v4"])
def test_drawn_tendons_are_as_much_shorter_as_they_are_pulled(name: str) -> None:
    """Straight between discs they are shorter than parallel curves, by 1/6 (bend per disc / 2)^2 and less."""
    model = shipped(name)
    assert model.statics is not None
    straight = lengths(tendon_lines(model, np.zeros(9)))[:9]
    for bends in 0.3 * random_bends(model, 5, 3):
        pulls = np.array(model.statics.pulls(bends))
        lines = tendon_lines(model, pulls)
        assert straight - lengths(lines)[:9] == pytest.approx(model.geometry.pulls(bends), abs=3e-4)
        tip, tangent, _ = placed(model, bends)
        last = lines[-1][:CORNERS]
        end = tip - model.geometry.tip_offset_m[2] * tangent
        assert last.mean(axis=0) == pytest.approx(end, abs=1e-9)
        assert (last - end) @ tangent == pytest.approx(np.zeros(CORNERS), abs=1e-9)


def test_the_scene_of_a_tendon_robot_has_them_and_its_backbone_is_as_long_as_before() -> None:
    loaded = with_mock(load_named("tendon3"))
    (config,), (robot,) = build_robot_configs(loaded, 100.0), loaded.file.robots.values()
    assert isinstance(config.model, TendonModel)
    scene = RobotScene(config, robot)
    drawing = scene.drawing((0.004, -0.002, -0.002) * 3)
    assert drawing is not None
    assert len(drawing.strips) - drawing.sections == 9 + 3 * DISCS + 1
    assert drawing.backbone_mm == pytest.approx(315.0, abs=0.1)
