"""Obstacles on the page: where their shapes are, by scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contid.robot_file.clearance import (
    BoxDescription,
    CapsuleDescription,
    ObstacleDescription,
    PlaneDescription,
    SphereDescription,
)
from contid_panel.obstacles import obstacle_shape

WORKSPACE = np.random.default_rng(1).uniform(-100.0, 100.0, (50, 3))


def test_corners_of_a_box_are_those_of_scipy() -> None:
    box = BoxDescription(center_mm=(1.0, 2.0, 3.0), size_mm=(40.0, 30.0, 20.0), yaw_deg=30.0)
    ((center, edges),) = obstacle_shape(ObstacleDescription(box=box), WORKSPACE)["boxes"]
    turn = Rotation.from_euler("z", 30.0, degrees=True)
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    corners = np.array(center) + signs @ np.array(edges)
    assert corners == pytest.approx(np.array([1.0, 2.0, 3.0]) + turn.apply(signs * [20.0, 15.0, 10.0]))


def test_each_kind_has_its_shapes() -> None:
    ball = ObstacleDescription(sphere=SphereDescription(center_mm=(1.0, 2.0, 3.0), radius_mm=4.0))
    assert obstacle_shape(ball, WORKSPACE) == {"balls": [[(1.0, 2.0, 3.0), 4.0]]}
    ends = (0.0, 0.0, 0.0), (0.0, 0.0, 50.0)
    post = ObstacleDescription(capsule=CapsuleDescription(start_mm=ends[0], end_mm=ends[1], radius_mm=4.0))
    shape = obstacle_shape(post, WORKSPACE)
    assert shape == {"balls": [[ends[0], 4.0], [ends[1], 4.0]], "tubes": [[*ends, 4.0]]}
    wall = ObstacleDescription(plane=PlaneDescription(point_mm=(0.0, 0.0, -300.0), normal=(0.0, 0.0, 1.0)))
    lines = np.array(obstacle_shape(wall, WORKSPACE)["lines"])
    assert lines.shape[1:] == (2, 3)
    assert lines[..., 2] == pytest.approx(-300.0)
