"""From frames of the room to measured tips, or to the reasons why there are none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.findings import allowed_names
from contid.targets import Vec3
from contid_camera.jumps import JumpGate
from contid_mocap.placing import Rigid, RoomPlacing, rigid
from contid_mocap.room import RoomFrame, RoomPose
from contid_mocap.setup_file import MocapSetup, TipPlace

#: After this number of frames in a row that are older than the newest one the server has started again.
RESTARTED: Final = 30
#: A capture may lie in the future by this much: the bound of a clock [s].
AHEAD_S: Final = 0.005
_WRAP: Final = 1 << 32


@dataclass(frozen=True, eq=False, slots=True)
class RoomTip:
    """A measured tip.

    Attributes:
        robot: its name.
        time_s: of the capture, by `time.monotonic`.
        tip_m: in the world.
        rotation: tip to world, shape ``(3, 3)``; None of a marker.
    """

    robot: str
    time_s: float
    tip_m: Vec3
    rotation: Array | None

    @property
    def direction(self) -> Vec3 | None:
        """Of the robot at its tip, in the world."""
        if self.rotation is None:
            return None
        x, y, z = self.rotation[:, 2].tolist()
        return (x, y, z)


@dataclass(frozen=True, slots=True)
class RoomLook:
    """The result of a frame for one robot: a tip, or a refusal.

    Attributes:
        robot: its name.
        tip: None when it is refused.
        refusal: why there is none, "" when there is.
        missing: frames that did not arrive since the one before.
        restarted: the numbers of the frames begin again.
    """

    robot: str
    tip: RoomTip | None
    refusal: str
    missing: int = 0
    restarted: bool = False


@dataclass(slots=True)
class _Tracked:
    """A robot that is tracked."""

    robot: str
    place: TipPlace
    in_body: Rigid
    jumps: JumpGate[RoomTip]
    number: int | None = None
    older: int = 0


class RoomTipTracker:
    """Measures tips in the frames of a room.

    Args:
        setup: of the room.
        robots: names that are tracked; empty for all of the setup.

    Raises:
        ContidError: a robot that the setup does not have, or points of the room that do not fit.
    """

    def __init__(self, setup: MocapSetup, robots: Sequence[str] = ()) -> None:
        for name in robots:
            if name not in setup.robots:
                raise ContidError(f"the setup has no robot {name!r}; {allowed_names(setup.robots, name)}")
        self._stale_s = setup.gate.stale_ms / 1e3
        self._room = RoomPlacing(setup.room)
        self._tracked = [
            _Tracked(name, place, rigid(place), JumpGate(setup.gate))
            for name, place in setup.robots.items()
            if name in robots or not robots
        ]

    @property
    def names(self) -> list[str]:
        """Names of the bodies and markers that are looked for."""
        return [each.place.name for each in self._tracked]

    def look(self, frame: RoomFrame, now_s: float) -> list[RoomLook]:
        """Measure the tips in a frame; robots whose bodies are not part of it are left out.

        Args:
            frame: in the order of arrival.
            now_s: `time.monotonic`.
        """
        room = self._room.now(frame)
        return [
            self._looked(each, frame, room, now_s) for each in self._tracked if each.place.name in frame.poses
        ]

    def _looked(self, each: _Tracked, frame: RoomFrame, room: Rigid | str, now_s: float) -> RoomLook:
        pose = frame.poses[each.place.name]
        ahead = 1 if each.number is None else (frame.number - each.number + _WRAP // 2) % _WRAP - _WRAP // 2
        if ahead == 0:
            return RoomLook(each.robot, None, "a frame comes twice")
        if ahead < 0:
            each.older += 1
            if each.older < RESTARTED:
                return RoomLook(each.robot, None, "a frame comes after a later one")
        each.number, each.older = frame.number, 0
        if ahead < 0:
            return RoomLook(each.robot, None, "the server has started again", restarted=True)
        tip = self._tip(each, frame, pose, room)
        refusal = tip if isinstance(tip, str) else self._refusal(each, tip, now_s)
        if isinstance(tip, str) or refusal:
            return RoomLook(each.robot, None, refusal, ahead - 1)
        return RoomLook(each.robot, tip, "", ahead - 1)

    def _tip(
        self, each: _Tracked, frame: RoomFrame, pose: RoomPose | None, room: Rigid | str
    ) -> RoomTip | str:
        """The tip in the world, or why there is none."""
        if pose is None:
            return f"{each.place.name!r} is not tracked"
        if isinstance(room, str):
            return room
        body = Rigid(np.eye(3) if pose.rotation is None else pose.rotation, np.array(pose.position_m))
        tip = room @ body @ each.in_body
        x, y, z = tip.shift.tolist()
        rotation = None if pose.rotation is None else tip.turn
        # Nothing is captured after it has arrived: the rest is the bound of the clock.
        ahead_s = frame.time_s - frame.received_s
        time_s = frame.received_s if 0.0 < ahead_s <= AHEAD_S else frame.time_s
        return RoomTip(each.robot, time_s, (x, y, z), rotation)

    def _refusal(self, each: _Tracked, tip: RoomTip, now_s: float) -> str:
        """Why a tip is refused; "" when it is taken."""
        age_s = now_s - tip.time_s
        if math.isnan(age_s):
            return "the clock of the server is not known yet"
        if age_s > self._stale_s:
            return f"the pose is {1e3 * age_s:.0f} ms old"
        if age_s < 0.0:
            return f"the pose is from {-1e3 * age_s:.0f} ms ahead"
        last = each.jumps.last
        if last is not None and tip.time_s <= last.time_s:
            return "the pose is older than the last"
        return each.jumps.refusal(tip)
