"""Obstacles on the page: where their shapes are, by scipy; and that a browser draws them."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.image import imread
from scipy.spatial.transform import Rotation

from contid.robot_file.clearance import (
    BoxDescription,
    CapsuleDescription,
    ObstacleDescription,
    PlaneDescription,
    SphereDescription,
)
from contid_panel.obstacles import obstacle_shape
from tests.support.daemons import armed, daemon
from tests.support.panels import panel
from tests.support.waiting import until

pytestmark = pytest.mark.process

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from tests.support.browser import OpenPage

OBSTACLES = """
clearance:
  bodies:
    f0: {radius_mm: 8}
  obstacles:
    crate: {box: {center_mm: [-100, 60, 0], size_mm: [40, 30, 20], yaw_deg: 30}}
    ball: {sphere: {center_mm: [110, 60, 0], radius_mm: 20}}
"""
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


def brown_pixels(page: OpenPage) -> int:
    """Pixels of the view in the colour of obstacles."""
    shot = io.BytesIO(page.page.locator("#view").screenshot())
    red, green, blue = np.moveaxis(imread(shot, format="png")[..., :3], -1, 0)
    hue = (red > green + 0.06) & (green > blue + 0.02) & (red < blue + 0.33)
    return int(np.count_nonzero(hue & (red < 0.75)))


@pytest.mark.realtime
@pytest.mark.parametrize("obstacles", ["", OBSTACLES])
def test_a_browser_draws_them(drawing: Browser, obstacles: str) -> None:
    from tests.support.browser import opened

    with daemon(1, change=lambda text: text + obstacles) as running:
        with running.client() as client:
            armed(client)
        with panel(running) as served, opened(drawing, served) as page:
            page.state("f0", "HOLD")
            if obstacles:
                until(lambda: brown_pixels(page) > 400, "the obstacles are drawn")
            else:
                page.page.wait_for_timeout(1000)
                assert brown_pixels(page) < 50
