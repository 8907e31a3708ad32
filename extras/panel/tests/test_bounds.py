"""The bounds of the sliders of a tip contain rest and every tip that random actuations reach."""

from __future__ import annotations

import random

import numpy as np
import pytest

from contid.robot_file.load import load_named
from contid_panel.geometry import PanelGeometry
from contid_panel.samples import tip_mm

#: Share of the size of the box by which the farthest of many random tips may lie outside.
SLACK = 0.02


@pytest.mark.parametrize(
    "name", ["hand", "tendon3", "ftdcr_v4", "trirack", "cbha", "stiffflop1", "stiffflop2"]
)
def test_bounds_contain_rest_the_ends_of_all_axes_and_random_tips(name: str) -> None:
    geometry = PanelGeometry(load_named(name), 200.0)
    described = geometry.describe()["robots"]
    numbers = random.Random(7)
    for robot in geometry.scene.robots:
        low, high = (np.array(each) for each in described[robot.config.name]["bounds"])
        model = robot.config.model
        for actuation in (robot.config.rest, model.lower, model.upper):
            tip = tip_mm(robot, actuation)
            assert tip is None or (np.all(tip > low - 0.01) and np.all(tip < high + 0.01)), (name, tip)
        limits = list(zip(model.lower, model.upper, strict=True))
        drawn = [tuple(numbers.uniform(*each) for each in limits) for _ in range(1000)]
        tips = np.array([tip for each in drawn if (tip := tip_mm(robot, each)) is not None])
        outside = np.maximum(low - tips, tips - high).max(axis=0)
        assert np.all(outside <= SLACK * np.maximum(high - low, 1.0)), (name, outside)


@pytest.mark.parametrize("name", ["hand", "trirack", "bend1", "catheter", "planar2", "tendon3", "trunk"])
def test_lines_of_a_body_are_its_backbone_then_tendons_then_discs(name: str) -> None:
    """Also where a motor winds several tendons, so that there are fewer axes than tendons."""
    geometry = PanelGeometry(load_named(name), 200.0)
    described = geometry.describe()["robots"]
    for robot in geometry.scene.robots:
        drawing = robot.drawing(robot.config.rest)
        assert drawing is not None
        found = described[robot.config.name]
        edges = 2 * robot.planar
        assert len(drawing.strips) == drawing.sections + found["tendons"] + found["discs"] + edges
