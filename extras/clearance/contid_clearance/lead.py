"""Models of redundant robots led around the obstacles of a robot file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Model
from contid.robot_file.clearance import Clearance
from contid.units import MM_PER_M
from contid_clearance.guard import obstacles_of
from contid_clearance.obstacles import Box, Capsule, Obstacle, Plane


def lead_around(model: Model, frame: BaseFrame, name: str, clearance: Clearance) -> None:
    """Have a model with redundant axes keep its body away from the obstacles of a file, if it can.

    Args:
        model: model of a robot; changed in place.
        frame: its base in the world.
        name: name of the robot.
        clearance: clearance of its file.
    """
    avoid = getattr(model, "avoid", None)
    body = clearance.bodies.get(name)
    if avoid is None or body is None:
        return
    ignored = {other for pair in clearance.ignore if name in pair for other in pair}
    rows = [
        tuple(in_base(frame, each).packed.tolist())
        for other, each in obstacles_of(clearance).items()
        if other not in ignored
    ]
    if rows:
        margin_m = clearance.margin_mm / MM_PER_M
        avoid(rows, body.radius_mm / MM_PER_M, margin_m, body.from_mm / MM_PER_M)


def in_base(frame: BaseFrame, obstacle: Obstacle) -> Obstacle:
    """An obstacle of the world in the frame of a base."""
    to_world = np.array(frame.rotation).reshape(3, 3)
    origin = np.array(frame.origin_in_world)
    match obstacle:
        case Plane():
            return Plane((obstacle.point - origin) @ to_world, obstacle.normal @ to_world)
        case Capsule():
            ends = (obstacle.start - origin) @ to_world, (obstacle.end - origin) @ to_world
            return Capsule(*ends, obstacle.radius_m)
        case Box():
            center, rotation = (obstacle.center - origin) @ to_world, to_world.T @ obstacle.rotation
            return replace(obstacle, center=center, rotation=rotation)
    raise TypeError(f"obstacle of a kind without a base frame: {type(obstacle).__name__}")
