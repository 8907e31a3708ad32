"""The ``clearance`` of a robot file: bodies, obstacles and the distance that is kept between them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, NamedTuple

from pydantic import Field, model_validator

from contid.errors import Located
from contid.robot_file.base import BasePose, Direction, NonNegative, Positive, Size, Strict
from contid.robot_file.findings import allowed_names
from contid.robot_file.positions import Document
from contid.robot_file.robot import RobotDescription
from contid.targets import Vec3
from contid.units import MM_PER_M


class BodyDescription(Strict):
    """The body of a robot: its backbone swept by a ball.

    Attributes:
        radius_mm: radius of the ball: half the width of the arm.
        from_mm: arc length from the base where the body begins, to leave out what its mount touches.
        tip_free_mm: length from the tip that may touch the tips of other robots, such as finger tips.
        tip_radius_mm: radius of that length against other tips; left out, ``radius_mm``. 0: the tip that
            targets mean is on the face that touches, so two tips may be commanded to one point.
    """

    radius_mm: Size
    from_mm: NonNegative = 0.0
    tip_free_mm: NonNegative = 0.0
    tip_radius_mm: NonNegative | None = None


class PlaneInBase(NamedTuple):
    """Unit normal of a plane in the frame of a base, and the plane's distance from the base along it."""

    normal: Vec3
    distance_mm: float


class PlaneDescription(Strict):
    """A half space, such as a table or a wall.

    Attributes:
        point_mm: a point on its surface.
        normal: direction out of it, of any length.
    """

    point_mm: Vec3
    normal: Direction

    def in_base(self, base: BasePose) -> PlaneInBase:
        """The plane in the frame of a base."""
        length = math.hypot(*self.normal)
        turn, origin = base.rotation, [MM_PER_M * v for v in base.position_m]
        unit = [v / length for v in self.normal]
        x, y, z = (sum(turn[3 * i + j] * unit[i] for i in range(3)) for j in range(3))
        offset = sum(n * (p - o) for n, p, o in zip(unit, self.point_mm, origin, strict=True))
        return PlaneInBase((x, y, z), offset)


class SphereDescription(Strict):
    """A sphere.

    Attributes:
        center_mm: centre in the world.
        radius_mm: radius of the sphere.
    """

    center_mm: Vec3
    radius_mm: Positive


class CapsuleDescription(Strict):
    """A cylinder with round ends, such as a post.

    Attributes:
        start_mm, end_mm: ends of its axis in the world.
        radius_mm: radius of the cylinder and of its ends.
    """

    start_mm: Vec3
    end_mm: Vec3
    radius_mm: Positive


class BoxDescription(Strict):
    """A box.

    Attributes:
        center_mm: centre in the world.
        size_mm: along its own x, y, z.
        roll_deg, pitch_deg, yaw_deg: its rotation, as of the base of a robot.
    """

    center_mm: Vec3
    size_mm: tuple[Positive, Positive, Positive]
    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0

    @property
    def rotation(self) -> tuple[float, ...]:
        """Row-major 3x3 matrix from box to world."""
        turned = BasePose(roll_deg=self.roll_deg, pitch_deg=self.pitch_deg, yaw_deg=self.yaw_deg)
        return turned.rotation


class ObstacleDescription(Strict):
    """One obstacle; exactly one of its keys.

    Attributes:
        plane: a half space.
        sphere: a sphere.
        capsule: a cylinder with round ends.
        box: a box.
    """

    plane: PlaneDescription | None = None
    sphere: SphereDescription | None = None
    capsule: CapsuleDescription | None = None
    box: BoxDescription | None = None

    @model_validator(mode="after")
    def _one(self) -> ObstacleDescription:
        given = [key for key in type(self).model_fields if getattr(self, key) is not None]
        if len(given) != 1:
            written = ", ".join(given) or "none"
            raise ValueError(f"an obstacle has one of plane, sphere, capsule, box; written: {written}")
        return self


class Clearance(Strict):
    """Distances that a trajectory must keep, between bodies of robots and to obstacles.

    Attributes:
        margin_mm: least distance between surfaces, also of a body that is bent back on itself.
        tip_depth_mm: depth by which two tips that may touch may be in each other; outside a plane at most
            half of the sum of their radii.
        bodies: bodies of the robots that are checked, by their names.
        obstacles: convex ones in the world, by names of your choice.
        ignore: pairs of a robot and a robot, itself or an obstacle that are not checked.
    """

    margin_mm: Annotated[float, Field(ge=0.5)] = 2.0
    tip_depth_mm: NonNegative = 0.5
    bodies: dict[str, BodyDescription] = Field(min_length=1)
    obstacles: dict[str, ObstacleDescription] = Field(default_factory=dict)
    ignore: tuple[tuple[str, str], ...] = ()


def check_clearance(
    document: Document, clearance: Clearance, robots: Mapping[str, RobotDescription | None]
) -> Iterator[Located]:
    """Findings where a name is not of a robot with actuators, or means two things.

    Args:
        document: the robot file.
        clearance: clearance to check.
        robots: robots of the file, None for one with mistakes.
    """
    at = ("clearance",)
    movable = [name for name, robot in robots.items() if robot is None or not robot.passive]
    for name in clearance.bodies:
        if name not in movable:
            what = "has no actuators" if name in robots else "is no robot of this file"
            message = f"bodies: {name!r} {what}; {allowed_names(movable, name)}"
            yield document.at_key((*at, "bodies", name), message)
    for name in clearance.obstacles:
        if name in robots:
            message = f"obstacles: {name!r} is the name of a robot; choose another"
            yield document.at_key((*at, "obstacles", name), message)
    names = [*clearance.bodies, *clearance.obstacles]
    for index, pair in enumerate(clearance.ignore):
        for item, name in enumerate(pair):
            if name not in names:
                message = f"ignore: no body or obstacle {name!r}; {allowed_names(names, name)}"
                yield document.at_value((*at, "ignore", index, item), message)
