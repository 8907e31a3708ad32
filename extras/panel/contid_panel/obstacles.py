"""The obstacles of a robot file as shapes for the page [mm], in the world frame; they never move."""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array
from contid.remote.protocol.wire import Fields
from contid.robot_file.clearance import ObstacleDescription
from contid_view.scene import plane_grid


def obstacle_shape(obstacle: ObstacleDescription, workspace: Array) -> Fields:
    """What the page draws of one obstacle.

    Args:
        obstacle: of the file's ``clearance``.
        workspace: points that the robots are likely to reach, (n, 3) [mm]; a plane is drawn beside it.

    Returns:
        ``lines``, ``balls``, ``tubes`` and ``boxes``, those that there are: points of each line; center and
        radius of each ball; ends and radius of each tube; center and three half edges of each box.
    """
    if obstacle.sphere is not None:
        return {"balls": [[obstacle.sphere.center_mm, obstacle.sphere.radius_mm]]}
    if obstacle.capsule is not None:
        start, end = obstacle.capsule.start_mm, obstacle.capsule.end_mm
        radius = obstacle.capsule.radius_mm
        return {"balls": [[start, radius], [end, radius]], "tubes": [[start, end, radius]]}
    if obstacle.box is not None:
        edges = np.reshape(obstacle.box.rotation, (3, 3)) * (0.5 * np.array(obstacle.box.size_mm))
        return {"boxes": [[obstacle.box.center_mm, edges.T.tolist()]]}
    assert obstacle.plane is not None
    return {"lines": [line.tolist() for line in plane_grid(obstacle.plane, workspace)]}
