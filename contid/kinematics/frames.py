"""Transforms between the world frame of trajectories and the base frame of a model.

    p_world = R p_base + o        with R = Rz Ry Rx M (M mirrors x if the robot file has a mirror)

R is orthogonal, also with the mirror: its inverse is its transpose. Directions and forces are not shifted by
o.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.robot_file.base import BasePose
from contid.targets import ZERO3, Target, Vec3, frame_of_axes


@dataclass(frozen=True, slots=True)
class BaseFrame:
    """A robot's base frame in the world.

    Attributes:
        rotation: R, from the base frame to the world, mirror included; nine numbers, row by row.
        origin_in_world: o, origin of the base frame in the world [m].
    """

    rotation: tuple[float, ...]
    origin_in_world: Vec3

    @classmethod
    def of(cls, base: BasePose) -> BaseFrame:
        """The frame a robot file describes."""
        return cls(base.rotation, base.position_m)

    def point_in_world(self, point: Vec3) -> Vec3:
        """A point of the base frame [m] in the world frame."""
        x, y, z = self.vector_in_world(point)
        origin = self.origin_in_world
        return (x + origin[0], y + origin[1], z + origin[2])

    def vector_in_world(self, vector: Vec3) -> Vec3:
        """A direction or force of the base frame in the world frame."""
        (x, y, z), r = vector, self.rotation
        return (
            r[0] * x + r[1] * y + r[2] * z,
            r[3] * x + r[4] * y + r[5] * z,
            r[6] * x + r[7] * y + r[8] * z,
        )

    def point_in_base(self, point: Vec3) -> Vec3:
        """A point of the world frame [m] in the base frame."""
        # Written out, without a call of `vector_in_base`: this runs for every robot in every tick.
        origin, r = self.origin_in_world, self.rotation
        x, y, z = point[0] - origin[0], point[1] - origin[1], point[2] - origin[2]
        return (
            r[0] * x + r[3] * y + r[6] * z,
            r[1] * x + r[4] * y + r[7] * z,
            r[2] * x + r[5] * y + r[8] * z,
        )

    def vector_in_base(self, vector: Vec3) -> Vec3:
        """A direction or force of the world frame in the base frame."""
        (x, y, z), r = vector, self.rotation
        return (
            r[0] * x + r[3] * y + r[6] * z,
            r[1] * x + r[4] * y + r[7] * z,
            r[2] * x + r[5] * y + r[8] * z,
        )

    def target_in_base(self, target: Target) -> Target:
        """A target in the world frame, with every position, direction and force in the base frame."""
        tip, mid, load, measured = target.tip_m, target.mid_m, target.load_n, target.measured_tip_m
        rotation = target.rotation
        # Written out: this runs for every robot in every tick, and `replace` costs three times as much.
        return Target(
            None if tip is None else self.point_in_base(tip),
            None if target.direction is None else self.vector_in_base(target.direction),
            None if mid is None else self.point_in_base(mid),
            target.actuation,
            load if load == ZERO3 else self.vector_in_base(load),
            target.extra,
            None if measured is None else self.point_in_base(measured),
            None if target.measured_direction is None else self.vector_in_base(target.measured_direction),
            None if rotation is None else self._frame_in_base(rotation),
            target.arcs,
        )

    def _frame_in_base(self, rotation: tuple[float, ...]) -> tuple[float, ...] | None:
        """The frame of a tip, row-major, in the base frame.

        It is formed from its z and x axes, because a mirror would make it left-handed.
        """
        z = self.vector_in_base((rotation[2], rotation[5], rotation[8]))
        return frame_of_axes(z, self.vector_in_base((rotation[0], rotation[3], rotation[6])))


def in_world(frame: BaseFrame, points_in_base: Array) -> Array:
    """Points ``(n, 3)`` of a base frame [m] in the world."""
    moved: Array = points_in_base @ np.array(frame.rotation).reshape(3, 3).T + frame.origin_in_world
    return moved
