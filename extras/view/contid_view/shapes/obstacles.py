"""Draws the obstacles of a robot file's ``clearance`` into a Rerun recording; they never move."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import rerun as rr

from contid.kinematics.array import Array
from contid.robot_file.clearance import (
    BoxDescription,
    CapsuleDescription,
    ObstacleDescription,
    SphereDescription,
)
from contid_view import paths
from contid_view.body import between, quaternion_of
from contid_view.colours import OBSTACLE
from contid_view.rerun.stream import RerunStream
from contid_view.scene import plane_grid

_SOLID: Final = rr.components.FillMode.Solid


def draw_obstacles(
    stream: RerunStream, obstacles: Mapping[str, ObstacleDescription], workspace: Array
) -> None:
    """Write every obstacle once.

    Args:
        stream: stream of the recording.
        obstacles: obstacles by name.
        workspace: points that the robots are likely to reach, (n, 3) [mm]; planes are drawn beside it.
    """
    for name, obstacle in obstacles.items():
        stream.static(paths.obstacle(name), _drawing(obstacle, workspace))


def _drawing(obstacle: ObstacleDescription, workspace: Array) -> Any:
    if obstacle.sphere is not None:
        return _sphere(obstacle.sphere)
    if obstacle.capsule is not None:
        return _capsule(obstacle.capsule)
    if obstacle.box is not None:
        return _box(obstacle.box)
    assert obstacle.plane is not None
    lines = plane_grid(obstacle.plane, workspace)
    return rr.LineStrips3D(lines, colors=[OBSTACLE], radii=rr.Radius.ui_points(0.75))


def _sphere(sphere: SphereDescription) -> rr.Ellipsoids3D:
    return rr.Ellipsoids3D(
        centers=[sphere.center_mm], radii=[sphere.radius_mm], colors=[OBSTACLE], fill_mode=_SOLID
    )


def _capsule(capsule: CapsuleDescription) -> rr.Capsules3D:
    axis = between(np.array([[capsule.start_mm]]), np.array([[capsule.end_mm]]))
    return rr.Capsules3D(
        lengths=axis.lengths[0], radii=[capsule.radius_mm], translations=[capsule.start_mm],
        quaternions=axis.quaternions[0], colors=[OBSTACLE], fill_mode=_SOLID,
    )  # fmt: skip


def _box(box: BoxDescription) -> rr.Boxes3D:
    rotation = np.array(box.rotation).reshape(3, 3)
    return rr.Boxes3D(
        centers=[box.center_mm], sizes=[box.size_mm], colors=[OBSTACLE], fill_mode=_SOLID,
        quaternions=[quaternion_of(rotation)],
    )  # fmt: skip
