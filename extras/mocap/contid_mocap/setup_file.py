"""The setup of a motion-capture room: where it stands, and what in it is the tip of which robot.

    contid_mocap: 1
    room: {up: y, x_mm: 120, y_mm: 0, z_mm: -40, yaw_deg: 90}
    robots:
      arm: {body: arm_tip, z_mm: 35}

``room`` is the pose of its frame in the world frame of the robot file, or known points, or a body on the
base.
The pose of a robot is that of the frame of its tip in the frame of the body: origin at the tip, z along the
direction of the robot.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from contid.robot_file.base import NonNegative, Placement, Positive, Strict
from contid.robot_file.findings import validated
from contid.robot_file.positions import read_document, read_text

#: A point of the room and the same in the world: x, y, z, x, y, z [mm].
PointPair = tuple[float, float, float, float, float, float]
Name = Annotated[str, Field(min_length=1, max_length=256)]


class TipPlace(Placement):
    """The tip of a robot in the frame of a body, or a marker at the tip.

    Attributes:
        body: rigid body or object, by name or number.
        marker: instead of a body, ``BODY:MARKER``; it gives no direction.
    """

    body: Name | None = None
    marker: Name | None = None

    @model_validator(mode="after")
    def _one(self) -> TipPlace:
        if (self.body is None) == (self.marker is None):
            raise ValueError("give `body` or `marker`, one of them")
        if self.marker is not None and (self.model_fields_set - {"marker"}):
            raise ValueError("a marker is the tip itself: it has no frame for a pose")
        return self

    @property
    def name(self) -> str:
        """Its name in the stream."""
        return self.body or self.marker or ""


class BaseBody(Placement):
    """A body that is fixed to the base, with its pose in the world frame.

    Attributes:
        body: its name or number.
        moved_mm: further from its mean it has moved, or the room was calibrated again.
        moved_deg: turned further from its mean it has moved as well.
    """

    body: Name
    moved_mm: Positive = 2.0
    moved_deg: Positive = 2.0


class RoomPlace(Placement):
    """Where the room is: its pose in the world frame, known points, or a body on the base.

    Attributes:
        up: the axis of the room that is z of the world before the rotation; Motive has y where not changed.
        fit: three and more points in the room and in the world.
        within_mm: greatest root mean square of their distances after the fit.
        base: a body on the base.
    """

    up: Literal["x", "y", "z", "-x", "-y", "-z"] = "z"
    fit: Annotated[tuple[PointPair, ...], Field(min_length=3)] | None = None
    within_mm: Positive = 2.0
    base: BaseBody | None = None

    @model_validator(mode="after")
    def _one(self) -> RoomPlace:
        pose = self.model_fields_set & {*Placement.model_fields, "up"}
        ways = [name for name, given in (("a pose", pose), ("fit", self.fit), ("base", self.base)) if given]
        if len(ways) != 1:
            found = " and ".join(ways) or "none"
            raise ValueError(f"give one of a pose (x_mm, .., up), `fit` and `base`; found {found}")
        return self


class MocapGate(Strict):
    """Bounds beyond which a pose is refused.

    Attributes:
        speed_mm_s: no tip is faster.
        turn_deg_s: no tip turns faster.
        jump_mm: distance that a tip may move between frames in addition to that of its speed.
        lost: number of refused poses in a row after which poses are accepted again, if they agree.
        stale_ms: a pose that is older when it is looked at is refused.
    """

    speed_mm_s: Positive = 1000.0
    turn_deg_s: Positive = 720.0
    jump_mm: Positive = 1.0
    lost: Annotated[int, Field(ge=2, le=10_000)] = 50
    stale_ms: Annotated[float, Field(ge=1.0, le=1000.0)] = 100.0


class ViconFacts(Strict):
    """What the Vicon stream does not carry.

    Attributes:
        rate_hz: frames per second; without it the time of arrival counts.
        latency_ms: from the capture to the arrival of the fastest frames.
        fixed_axes: Euler angles turn about the axes of the room instead of those of the object.
    """

    rate_hz: Annotated[float, Field(ge=1.0, le=5000.0)] | None = None
    latency_ms: NonNegative = 0.0
    fixed_axes: bool = False


class MocapSetup(Strict):
    """A whole setup.

    Attributes:
        contid_mocap: version of the format.
        room: where it is.
        robots: tips by the name of the robot.
        gate: bounds beyond which a pose is refused.
        vicon: for `contid track vicon`.
    """

    contid_mocap: Literal[1]
    room: RoomPlace
    robots: Annotated[dict[str, TipPlace], Field(min_length=1)]
    gate: MocapGate = MocapGate()
    vicon: ViconFacts = ViconFacts()


def read_setup(path: Path) -> MocapSetup:
    """The setup of a file.

    Raises:
        BadInputError: mistakes, with their places.
        ContidError: the file cannot be read.
    """
    return validated(read_document(read_text(path), str(path)), MocapSetup)
