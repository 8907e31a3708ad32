"""What a motion-capture system sends: bodies and markers by name in the frame of the room."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from contid.kinematics.array import Array
from contid.targets import Vec3

#: A position further away than this is no position [m].
MAX_M: Final = 1000.0
#: A quaternion whose norm is further from 1 than this is none.
MAX_NORM_ERROR: Final = 0.01


@dataclass(frozen=True, eq=False, slots=True)
class RoomPose:
    """A body or a marker in the frame of the room.

    Attributes:
        position_m: of its origin.
        rotation: body to room, shape ``(3, 3)``; None of a marker.
    """

    position_m: Vec3
    rotation: Array | None


@dataclass(frozen=True, slots=True)
class RoomFrame:
    """What was captured at one time, or a part of it.

    Attributes:
        number: of the frame, 32 bits.
        time_s: of the capture, by `time.monotonic` on this machine; NaN while it is not known.
        received_s: of the arrival, by the same clock.
        poses: by name; markers are named ``BODY:MARKER``. None is in view of the system, but not usable.
    """

    number: int
    time_s: float
    received_s: float
    poses: Mapping[str, RoomPose | None]


class RoomStream(Protocol):
    """A connection to a motion-capture system."""

    def poll(self, timeout_s: float) -> list[RoomFrame]:
        """Frames that have arrived, in their order; waits for the first at most that long."""

    def restart(self) -> None:
        """Forget the clock of a server that has started again."""

    def facts(self) -> list[str]:
        """Lines for the report."""

    def names(self) -> list[str]:
        """Names of bodies and markers."""

    def close(self) -> None:
        """Close its sockets."""


def usable_position(position_m: Vec3) -> bool:
    """True of finite numbers inside any room."""
    return all(abs(value) <= MAX_M for value in position_m)  # NaN compares False


def rotation_of(quaternion_xyzw: tuple[float, float, float, float]) -> Array | None:
    """The rotation of a unit quaternion, shape ``(3, 3)``; None when it is none."""
    norm = math.hypot(*quaternion_xyzw)
    if not abs(norm - 1.0) <= MAX_NORM_ERROR:
        return None
    x, y, z, w = (value / norm for value in quaternion_xyzw)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
