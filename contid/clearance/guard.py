"""The bodies, obstacles and pairs of a robot file, and the distances of one configuration.

The kernel ``contid/kernels/clearance`` bounds the distance between two bodies, and between a body and an
obstacle, by branch and bound. The result holds for the curves between the samples, not only for the samples.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from contid.clearance.body import Body, sampled_body
from contid.clearance.obstacles import Box, Capsule, Obstacle, Plane
from contid.kernels import load
from contid.kinematics.body_shape import in_world
from contid.kinematics.extra_axes import build_whole_model
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Model
from contid.robot_file.clearance import Clearance, ObstacleDescription
from contid.robot_file.document import RobotFile
from contid.targets import ZERO3, Actuation, Vec3
from contid.units import MM_PER_M, m_to_mm


@dataclass(frozen=True, slots=True)
class Distance:
    """A distance between surfaces: ``lower_m <= truth <= upper_m``, negative for a penetration.

    Attributes:
        lower_m, upper_m: bounds [m].
        at_m: arc length from the base of the first body where it is nearest [m].
    """

    lower_m: float
    upper_m: float
    at_m: float


def between_bodies(a: Body, b: Body, enough_m: float = math.inf) -> Distance:
    """Distance between the surfaces of two bodies [m].

    Args:
        a: a body.
        b: another body.
        enough_m: stop halving as soon as the distance is certainly at least this.
    """
    radii, off_m = a.radius_m + b.radius_m, a.off_m + b.off_m
    enough = enough_m + radii + off_m
    found = load("clearance").between(a.points, a.spacing_m, b.points, b.spacing_m, enough)
    at_m = a.start_m + found.at * a.spacing_m
    return Distance(found.lower - radii - off_m, found.upper - radii + off_m, at_m)


def to_obstacle(body: Body, obstacle: Obstacle, enough_m: float = math.inf) -> Distance:
    """Distance between the surfaces of a body and of a convex obstacle [m].

    Args:
        body: the body.
        obstacle: a convex set.
        enough_m: stop halving as soon as the distance is certainly at least this.
    """
    radius_m, off_m = body.radius_m, body.off_m
    enough = enough_m + radius_m + off_m
    found = load("clearance").to_obstacle(body.points, body.spacing_m, obstacle.packed, enough)
    at_m = body.start_m + found.at * body.spacing_m
    return Distance(found.lower - radius_m - off_m, found.upper - radius_m + off_m, at_m)


#: One base per coordinate.
PRIMES: Final = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89)


def radical_inverse(index: int, base: int) -> float:
    """Van der Corput's sequence in [0, 1): digits of the index mirrored at the point (Halton 1960)."""
    value, scale = 0.0, 1.0 / base
    while index:
        index, digit = divmod(index, base)
        value += digit * scale
        scale /= base
    return value


#: Actuation and known force on the tip in the world [N], by robot.
Configuration: TypeAlias = Mapping[str, tuple[Actuation, Vec3]]

#: The greatest speed of a body is searched among this many actuations, and multiplied by the factor.
SPEED_SAMPLES: Final = 24
SPEED_FACTOR: Final = 1.5
_STEP: Final = 1e-3
_POINTS: Final = 17


@dataclass(frozen=True, eq=False, slots=True)
class Arm:
    """A robot whose body is checked.

    Attributes:
        name: name in the robot file.
        model: kinematics, with the extra axes.
        frame: its base in the world.
        radius_m: radius of its body [m].
        from_m: where the body begins [m].
        tip_free_m: length at the tip that may touch other robots [m].
        speed: greatest motion of a point of the body per change of each axis [m/m or m/Pa].
    """

    name: str
    model: Model
    frame: BaseFrame
    radius_m: float
    from_m: float
    tip_free_m: float
    speed: tuple[float, ...]

    def bodies(self, actuation: Actuation, load_n: Vec3) -> tuple[Body, Body]:
        """The body against obstacles, and the one against other robots."""
        load = self.frame.vector_in_base(load_n)

        def curve(count: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
            return in_world(self.frame, self.model.shape(actuation, count, load))

        whole = sampled_body(curve, self.radius_m)
        length = whole.pieces * whole.spacing_m
        rooted = whole.part(self.from_m, length) if self.from_m > 0.0 else whole
        if self.tip_free_m == 0.0:
            return rooted, rooted
        return rooted, whole.part(self.from_m, max(length - self.tip_free_m, self.from_m))

    def motion_m(self, before: Actuation, after: Actuation) -> float:
        """Bound of the motion of every point of the body between two actuations [m]."""
        return sum(k * abs(b - a) for k, a, b in zip(self.speed, before, after, strict=True))


@dataclass(frozen=True, slots=True)
class Nearest:
    """The distance of one pair: of a robot, and of another or an obstacle."""

    robot: str
    other: str
    distance: Distance

    def __str__(self) -> str:
        """The encounter as a sentence without its full stop."""
        found = self.distance
        where = f"{self.robot} at {m_to_mm(found.at_m):.0f} mm of its length"
        if found.upper_m <= 0.0:
            return f"{where} runs into {self.other}"
        return f"{where} comes within {m_to_mm(max(found.lower_m, 0.0)):.2f} mm of {self.other}"


class ClearanceGuard:
    """What a robot file states about clearance, ready to be evaluated.

    Args:
        file: a robot file.
        clearance: clearance of this file.
    """

    def __init__(self, file: RobotFile, clearance: Clearance) -> None:
        self.margin_m: float = clearance.margin_mm / MM_PER_M
        self.arms: dict[str, Arm] = {name: _arm(file, clearance, name) for name in clearance.bodies}
        self.obstacles: dict[str, Obstacle] = obstacles_of(clearance)
        ignored = {frozenset(pair) for pair in clearance.ignore}
        every = [*itertools.combinations(self.arms, 2), *itertools.product(self.arms, self.obstacles)]
        self.pairs: tuple[tuple[str, str], ...] = tuple(p for p in every if frozenset(p) not in ignored)
        robots = file.robots
        self.rest: dict[str, Actuation] = {
            name: (*robots[name].rest, *arm.model.lower[len(robots[name].axis_names) :])
            for name, arm in self.arms.items()
        }

    def at_rest(self) -> list[Nearest]:
        """The distances with every robot at its rest pose, nearest first."""
        rest = {name: (actuation, ZERO3) for name, actuation in self.rest.items()}
        found = Shapes(self, rest)
        return sorted((found.nearest(pair) for pair in self.pairs), key=lambda n: n.distance.lower_m)


class Shapes:
    """The bodies of one configuration; computed when a distance needs them."""

    def __init__(self, guard: ClearanceGuard, configuration: Configuration) -> None:
        self._guard = guard
        self._configuration = configuration
        self._bodies: dict[str, tuple[Body, Body]] = {}

    def nearest(self, pair: tuple[str, str], enough_m: float = np.inf) -> Nearest:
        """The distance of a pair; only a bound where that is ``enough_m`` at least."""
        robot, other = pair
        whole, part = self._body(robot)
        if other in self._guard.obstacles:
            return Nearest(robot, other, to_obstacle(whole, self._guard.obstacles[other], enough_m))
        return Nearest(robot, other, between_bodies(part, self._body(other)[1], enough_m))

    def _body(self, name: str) -> tuple[Body, Body]:
        if name not in self._bodies:
            self._bodies[name] = self._guard.arms[name].bodies(*self._configuration[name])
        return self._bodies[name]


def _arm(file: RobotFile, clearance: Clearance, name: str) -> Arm:
    robot, body = file.robots[name], clearance.bodies[name]
    model = build_whole_model(robot)
    return Arm(
        name=name,
        model=model,
        frame=BaseFrame.of(robot.base),
        radius_m=body.radius_mm / MM_PER_M,
        from_m=body.from_mm / MM_PER_M,
        tip_free_m=body.tip_free_mm / MM_PER_M,
        speed=body_speed(model, len(robot.axis_names)),
    )


def body_speed(model: Model, own_axes: int) -> tuple[float, ...]:
    """Greatest motion of a point of the body per change of each axis, 0 for extra axes.

    Differences at `SPEED_SAMPLES` actuations, times `SPEED_FACTOR`: an estimate, not a proof.
    """
    low, high = np.array(model.lower[:own_axes]), np.array(model.upper[:own_axes])
    rest = model.lower[own_axes:]
    greatest = np.zeros(own_axes)
    for k in range(1, SPEED_SAMPLES + 1):
        part = np.array([radical_inverse(k, base) for base in PRIMES[:own_axes]])
        actuation = low + (high - low) * (_STEP + (1.0 - 2.0 * _STEP) * part)
        points = model.shape((*actuation.tolist(), *rest), _POINTS)
        for axis in range(own_axes):
            moved = actuation.copy()
            moved[axis] += _STEP * (high - low)[axis]
            moved_points = model.shape((*moved.tolist(), *rest), _POINTS)
            motion = float(np.max(np.linalg.norm(moved_points - points, axis=1)))
            greatest[axis] = max(greatest[axis], motion / (_STEP * float((high - low)[axis])))
    return (*(SPEED_FACTOR * greatest).tolist(), *(0.0 for _ in rest))


def obstacles_of(clearance: Clearance) -> dict[str, Obstacle]:
    """The obstacles of a file in the world, by name."""
    return {name: _obstacle(each) for name, each in clearance.obstacles.items()}


def _obstacle(description: ObstacleDescription) -> Obstacle:
    if description.plane is not None:
        normal = np.array(description.plane.normal)
        return Plane(np.array(description.plane.point_mm) / MM_PER_M, normal / np.linalg.norm(normal))
    if description.sphere is not None:
        center = np.array(description.sphere.center_mm) / MM_PER_M
        return Capsule(center, center, description.sphere.radius_mm / MM_PER_M)
    if description.capsule is not None:
        capsule = description.capsule
        ends = np.array([capsule.start_mm, capsule.end_mm]) / MM_PER_M
        return Capsule(ends[0], ends[1], capsule.radius_mm / MM_PER_M)
    box = description.box
    assert box is not None, "an obstacle has one key"
    rotation = np.array(box.rotation).reshape(3, 3)
    return Box(np.array(box.center_mm) / MM_PER_M, rotation, 0.5 * np.array(box.size_mm) / MM_PER_M)
