"""The measured shape: a curve from the base to where a tracker sees the tip, and how it points there.

It is the Pythagorean-hodograph quintic of `contid shape --from-poses`. Of the robot's model it knows the
length only, so it can be looked at beside the model's backbone. It is computed where somebody looks, never in
a tick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from contid.control.engine.tick_layout import RobotRecord
from contid.control.tick.config import RobotConfig
from contid.kinematics.body_shape import from_pose, from_rough_pose
from contid.units import MM_PER_M

#: Points of the curve.
POINTS: Final = 33
#: A tip this near its base [m] leaves no curve to draw.
NEAREST_M: Final = 1e-4


@dataclass(frozen=True, slots=True)
class MeasuredShape:
    """What a tracker sees of one robot.

    Attributes:
        tip: where it sees the tip, (1, 3) [mm], world frame.
        line: curve from the base to it, (n, 3) [mm]; None when it sees no direction.
    """

    tip: NDArray[np.float64]
    line: NDArray[np.float64] | None


def sight(config: RobotConfig, record: RobotRecord, length_mm: float | None) -> MeasuredShape | None:
    """What the tracker saw at a tick; None while there is none.

    Args:
        config: of the robot.
        record: its part of the tick.
        length_mm: of the backbone, as the samples of the actuators have it; None while they are unknown. Then
            the curve is good up to some 150 degrees of bending (docs/ph-curves.md).
    """
    tip, direction = record.measured_tip_m, record.measured_direction
    if not all(map(math.isfinite, tip)):
        return None
    point = np.array([tip]) * MM_PER_M
    # A direction that was seen is a unit vector; NaN is not greater than anything.
    if not math.hypot(*direction) > 0.5 or math.dist(tip, config.frame.origin_in_world) < NEAREST_M:
        return MeasuredShape(point, None)
    frame, dimension = config.frame, config.model.dimension
    if length_mm is None:
        shape = from_pose(frame, tip, direction, POINTS, dimension=dimension)
    else:
        shape = from_rough_pose(frame, tip, direction, POINTS, length_mm / MM_PER_M, dimension)
    return MeasuredShape(point, shape.points_in_world * MM_PER_M)
