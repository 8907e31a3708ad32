"""The measured shape: a curve from the base to the tip and direction that a tracker measured.

It is the Pythagorean-hodograph quintic of `contid shape --from-poses`. Of the robot's model it uses only the
length, so it can be compared with the model's backbone. It is computed for drawings, never in a tick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.control.engine.tick_layout import RobotRecord
from contid.control.tick.config import RobotConfig
from contid.kinematics.array import Array
from contid.units import MM_PER_M
from contid_ropes.body_shape import from_pose

#: Points of the curve.
POINTS: Final = 33
#: A tip closer to its base than this [m] has no curve.
MIN_DISTANCE_M: Final = 1e-4


@dataclass(frozen=True, slots=True)
class MeasuredShape:
    """What a tracker measured of one robot, world frame.

    Attributes:
        tip: position, (1, 3) [mm].
        line: curve from the base to the tip, (n, 3) [mm]; None without a measured direction.
    """

    tip: Array
    line: Array | None


def measured_shape(config: RobotConfig, record: RobotRecord, length_mm: float | None) -> MeasuredShape | None:
    """What the tracker measured at a tick; None without a measurement.

    Args:
        config: configuration of the robot.
        record: its part of the tick.
        length_mm: length of the backbone from the samples of the actuators; None while they are unknown, the
            curve is then valid up to some 150 degrees of bending (docs/robots/ph-curves.md).
    """
    tip, direction = record.measured_tip_m, record.measured_direction
    if not all(map(math.isfinite, tip)):
        return None
    point = np.array([tip]) * MM_PER_M
    # A measured direction is a unit vector; a comparison with NaN is false.
    if not math.hypot(*direction) > 0.5 or math.dist(tip, config.frame.origin_in_world) < MIN_DISTANCE_M:
        return MeasuredShape(point, None)
    frame, dimension = config.frame, config.model.dimension
    length_m = None if length_mm is None else length_mm / MM_PER_M
    shape = from_pose(frame, tip, direction, POINTS, length_m, dimension, rough=True)
    return MeasuredShape(point, shape.points_in_world * MM_PER_M)
