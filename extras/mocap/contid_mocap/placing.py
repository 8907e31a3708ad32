"""From the frame of the room to the world frame of the robot file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.base import Placement
from contid.units import MM_PER_M
from contid_adapt.placing.rigid_fit import rigid_fit
from contid_mocap.room import RoomFrame
from contid_mocap.setup_file import BaseBody, RoomPlace

#: Rows are the axes x, y, z of the world in those of the room, by the axis of the room that is up.
_UP: Final = {
    "z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)), "-z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)), "-y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "x": ((0, 1, 0), (0, 0, 1), (1, 0, 0)), "-x": ((0, 1, 0), (0, 0, -1), (-1, 0, 0)),
}  # fmt: skip
#: The pose of the body on the base is averaged over this number of frames.
AVERAGED: Final = 200
#: After this number of frames with a moved body its average begins again.
MOVED_FRAMES: Final = 20


@dataclass(frozen=True, eq=False, slots=True)
class Rigid:
    """A rigid motion ``p -> turn p + shift``.

    Attributes:
        turn: shape ``(3, 3)``.
        shift: shape ``(3,)`` [m].
    """

    turn: Array
    shift: Array

    def __matmul__(self, inner: Rigid) -> Rigid:
        """First the other one, then this one."""
        return Rigid(self.turn @ inner.turn, self.turn @ inner.shift + self.shift)

    def inverse(self) -> Rigid:
        """The motion back."""
        return Rigid(self.turn.T, -(self.turn.T @ self.shift))


def rigid(place: Placement) -> Rigid:
    """A placement of a file as a motion."""
    return Rigid(np.array(place.rotation).reshape(3, 3), np.array(place.position_m))


class RoomPlacing:
    """Where the room is in the world; known from the setup, or from a body on the base.

    Args:
        place: of the setup.

    Raises:
        ContidError: points that do not fit.
    """

    def __init__(self, place: RoomPlace) -> None:
        self._base = place.base
        self._fixed: Rigid | None = None
        self._mean: Rigid | None = None
        self._count = self._off = 0
        if place.fit is not None:
            self._fixed = fitted(np.array(place.fit) / MM_PER_M, place.within_mm)
        elif place.base is None:
            self._fixed = rigid(place) @ Rigid(np.array(_UP[place.up], dtype=float), np.zeros(3))

    def now(self, frame: RoomFrame) -> Rigid | str:
        """The motion from the room to the world, or why it is not known.

        Args:
            frame: the newest; a body on the base is looked for in it.
        """
        base = self._base
        if base is not None:
            if (pose := frame.poses.get(base.body)) is not None and pose.rotation is not None:
                self._average(Rigid(pose.rotation, np.array(pose.position_m)), base)
            # Also when it is lost after it has moved, or comes in another part of the frame than the tip.
            if self._off:
                return f"the body {base.body!r} on the base has moved"
            if self._fixed is None:
                return f"the body {base.body!r} on the base was not seen yet"
        assert self._fixed is not None
        return self._fixed

    def _average(self, seen: Rigid, base: BaseBody) -> None:
        """Take the body on the base into the average, unless it has moved."""
        mean = self._mean
        if mean is not None and _apart(mean, seen, base):
            self._off += 1
            if self._off < MOVED_FRAMES:
                return
            mean, self._count = None, 0
        self._off = 0
        self._count = min(self._count + 1, AVERAGED)
        share = 1.0 / self._count
        if mean is None:
            mean = seen
        else:
            u, _, vt = np.linalg.svd(mean.turn + share * (seen.turn - mean.turn))
            mean = Rigid(u @ vt, mean.shift + share * (seen.shift - mean.shift))
        self._mean, self._fixed = mean, rigid(base) @ mean.inverse()


def _apart(mean: Rigid, seen: Rigid, base: BaseBody) -> bool:
    """Whether a body is further from its mean than noise is, in place or angle."""
    cosine = 0.5 * (float(np.trace(mean.turn.T @ seen.turn)) - 1.0)
    turned_deg = math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))
    shifted_mm = float(np.linalg.norm(seen.shift - mean.shift)) * MM_PER_M
    return shifted_mm > base.moved_mm or turned_deg > base.moved_deg


def fitted(pairs: Array, within_mm: float) -> Rigid:
    """The rigid motion that takes points of the room to points of the world.

    Args:
        pairs: points in the room, then in the world, shape ``(n, 6)`` [m].
        within_mm: greatest root mean square of the distances.

    Raises:
        ContidError: the points lie on a line, or do not fit.
    """
    found = rigid_fit(pairs[:, :3], pairs[:, 3:])
    if found is None:
        raise ContidError("room.fit: the points lie on a line; a plane at least is needed")
    rms_mm = found.rms * MM_PER_M
    if rms_mm > within_mm:
        raise ContidError(
            f"room.fit: the points fit with {rms_mm:.3g} mm rms only; room.within_mm is {within_mm:g}"
        )
    return Rigid(found.turn, found.at - found.turn @ found.origin)
