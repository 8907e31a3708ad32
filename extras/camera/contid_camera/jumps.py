"""Jumps of a measured tip: refused, unless several poses in a row agree that the tip is there."""

from __future__ import annotations

import math
from typing import Generic, Protocol, TypeVar

import numpy as np

from contid.kinematics.array import Array
from contid.targets import Vec3
from contid.units import MM_PER_M


class TimedPose(Protocol):
    """What the gate compares."""

    @property
    def time_s(self) -> float:
        """Time of the capture."""

    @property
    def tip_m(self) -> Vec3:
        """Tip in the world."""

    @property
    def rotation(self) -> Array | None:
        """Tip to world, shape ``(3, 3)``; None where it is not measured."""


class JumpBounds(Protocol):
    """Bounds of a motion, as the gate of a setup has them."""

    @property
    def speed_mm_s(self) -> float:
        """No tip is faster."""

    @property
    def turn_deg_s(self) -> float:
        """No tip turns faster."""

    @property
    def jump_mm(self) -> float:
        """Distance that a tip may move between poses in addition to that of its speed."""

    @property
    def lost(self) -> int:
        """Number of refused poses in a row after which poses are accepted again, if they agree."""


_Pose = TypeVar("_Pose", bound=TimedPose)


class JumpGate(Generic[_Pose]):
    """Refuses poses that a tip cannot have reached from the last accepted one.

    Args:
        bounds: of the motion.
    """

    def __init__(self, bounds: JumpBounds) -> None:
        self._bounds = bounds
        self._strays: list[_Pose] = []
        #: The newest pose that was accepted.
        self.last: _Pose | None = None

    def refusal(self, pose: _Pose, certain: bool = True) -> str:
        """Why a pose is refused; "" when it is accepted.

        Args:
            pose: newer than the last.
            certain: False for a pose that must not end a series of refusals.
        """
        jump = "" if self.last is None else self._jump(self.last, pose)
        if jump:
            if self._strays and self._jump(self._strays[-1], pose):
                self._strays = []
            self._strays.append(pose)
            if len(self._strays) < self._bounds.lost or not certain:
                return jump
        self.last, self._strays = pose, []
        return ""

    def _jump(self, before: _Pose, after: _Pose) -> str:
        """What a tip cannot have done in the time between; "" when it can be there."""
        bounds, seconds = self._bounds, max(after.time_s - before.time_s, 0.0)
        off_mm = math.dist(before.tip_m, after.tip_m) * MM_PER_M
        if off_mm > bounds.speed_mm_s * seconds + bounds.jump_mm:
            return f"the tip jumps by {off_mm:.1f} mm"
        if before.rotation is None or after.rotation is None:
            return ""
        turned_deg = math.degrees(turn_rad(before.rotation, after.rotation))
        if turned_deg > bounds.turn_deg_s * seconds + 3.0:
            return f"the tip turns by {turned_deg:.0f} degrees at once"
        return ""


def turn_rad(a: Array, b: Array) -> float:
    """Angle between two rotations."""
    cosine = 0.5 * (float(np.sum(a * b)) - 1.0)
    return math.acos(min(max(cosine, -1.0), 1.0))
