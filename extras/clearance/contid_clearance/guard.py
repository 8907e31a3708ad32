"""The bodies, obstacles and pairs of a robot file, and the distances of one configuration.

A pair is two robots, a robot and an obstacle, or a robot with itself. It keeps `ClearanceGuard.margin_m`,
except two tips that may touch: those may be `ClearanceGuard.tip_depth_m` in each other. What a pair has left
above that is its spare distance.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np

from contid.control.tick.preflight.kept_apart import Configuration
from contid.kinematics.extra_axes import build_whole_model
from contid.kinematics.frames import BaseFrame
from contid.robot_file.clearance import Clearance, ObstacleDescription
from contid.robot_file.document import RobotFile
from contid.targets import ZERO3, Actuation, Vec3
from contid.units import MM_PER_M, m_to_mm
from contid_clearance.arm import Arm, ArmParts, BodySpeeds, body_speeds
from contid_clearance.body import Body
from contid_clearance.crossing import crossed_m
from contid_clearance.distances import Distance, between_bodies, to_itself, to_obstacle
from contid_clearance.obstacles import Box, Capsule, Obstacle, Plane

#: Name of a robot, and name of another robot or of an obstacle, or its own.
Pair: TypeAlias = tuple[str, str]
#: Distances of pairs that are sampled are computed up to the margin and this [m].
LOOK_AHEAD_M: Final = 0.05


@dataclass(frozen=True, slots=True)
class Nearest:
    """The distance of one pair: of a robot, and of another, itself or an obstacle.

    Attributes:
        robot: name of the robot.
        other: the other name of the pair.
        distance: between the parts that have the least to spare.
        least_m: distance that these parts keep [m]; negative for tips that may be pressed into each other.
    """

    robot: str
    other: str
    distance: Distance
    least_m: float

    @property
    def spare_m(self) -> float:
        """Distance left, certainly; negative when the pair is too near [m]."""
        return self.distance.lower_m - self.least_m

    def __str__(self) -> str:
        """The encounter and the key that forbids it, as a sentence without its full stop."""
        found = self.distance
        where = f"{self.robot} at {m_to_mm(found.at_m):.0f} mm of its length"
        other = "itself" if self.other == self.robot else self.other
        if self.least_m < 0.0:
            how = (
                f"{where}, a tip, reaches {m_to_mm(max(-found.lower_m, 0.0)):.2f} mm into the tip of {other}"
            )
            return f"{how}; clearance.tip_depth_mm is {m_to_mm(-self.least_m):g}"
        margin = f"; clearance.margin_mm is {m_to_mm(self.least_m):g}"
        if found.upper_m <= 0.0:
            return f"{where} runs into {other}{margin}"
        return f"{where} comes within {m_to_mm(max(found.lower_m, 0.0)):.2f} mm of {other}{margin}"


class ClearanceGuard:
    """What a robot file states about clearance, ready to be evaluated.

    Args:
        file: a robot file.
        clearance: clearance of this file.

    Attributes:
        margin_m: distance that every pair keeps [m], except tips that may touch.
        tip_depth_m: depth to which two tips that may touch may be in each other [m].
        arms: by robot.
        obstacles: in the world, by name.
        pairs: pairs whose distance is bounded along a motion (`Shapes.nearest`): of two robots that of their
            shafts, of a robot and an obstacle that of the whole body.
        sampled: pairs whose distance is computed at points of a motion, without a bound between these
            (`Shapes.sampled`): those with a tip that may touch, and a body with itself, which are near for as
            long as something is held.
        rest: actuation of every robot at its rest pose, extra axes at their lower limits.
        parts_of: computes the parts of the body of a robot for its actuation and the known force on its tip
            [N]; the control loop replaces it by what makes an error one of that robot.
        asks_as_before: by motion rules below 10, models are asked for bodies as often as they were then. The
            replay of a question without an answer counts that. A short body is not seen again.
    """

    def __init__(self, file: RobotFile, clearance: Clearance) -> None:
        self.margin_m: float = clearance.margin_mm / MM_PER_M
        self.tip_depth_m: float = clearance.tip_depth_mm / MM_PER_M
        self.arms: dict[str, Arm] = {name: _arm(file, clearance, name) for name in clearance.bodies}
        self.obstacles: dict[str, Obstacle] = obstacles_of(clearance)
        ignored = {frozenset(pair) for pair in clearance.ignore}
        arms = [*itertools.combinations(self.arms, 2)]
        every = [*arms, *itertools.product(self.arms, self.obstacles)]
        self.pairs: tuple[Pair, ...] = tuple(p for p in every if frozenset(p) not in ignored)
        tips = [p for p in arms if any(self.arms[name].tip_free_m > 0.0 for name in p)]
        near = [*tips, *((name, name) for name in self.arms)]
        self.sampled: tuple[Pair, ...] = tuple(p for p in near if frozenset(p) not in ignored)
        robots = file.robots
        self.rest: dict[str, Actuation] = {
            name: (*robots[name].rest, *arm.model.lower[len(robots[name].axis_names) :])
            for name, arm in self.arms.items()
        }
        self.parts_of: Callable[[str, Actuation, Vec3], ArmParts] = self._parts_of
        self.asks_as_before = False

    def ask_as_before(self) -> None:
        """See `asks_as_before`: twice the motion of a body bounds its distances to itself."""
        self.asks_as_before = True
        for name, arm in self.arms.items():
            of_points = arm.speeds.of_points
            self.arms[name] = replace(arm, speeds=BodySpeeds(of_points, tuple([2.0 * k for k in of_points])))

    def _parts_of(self, name: str, actuation: Actuation, load_n: Vec3) -> ArmParts:
        return self.arms[name].parts(actuation, load_n)

    def at_rest(self) -> list[Nearest]:
        """The distances with every robot at its rest pose, the one with the least to spare first."""
        rest = {name: (actuation, ZERO3) for name, actuation in self.rest.items()}
        found = Shapes(self, rest)
        every = [*map(found.nearest, self.pairs), *map(found.sampled, self.sampled)]
        return sorted(every, key=lambda each: each.spare_m)


class Shapes:
    """The bodies of one configuration; each is computed when a distance needs it first.

    Args:
        guard: what a robot file states.
        configuration: of every robot whose distance is asked for.
    """

    def __init__(self, guard: ClearanceGuard, configuration: Configuration) -> None:
        self._guard = guard
        self._configuration = configuration
        self._parts: dict[str, ArmParts] = {}

    def nearest(self, pair: Pair, enough_m: float = np.inf) -> Nearest:
        """The distance of one of `ClearanceGuard.pairs`.

        Args:
            pair: of two robots the distance is that of their shafts, without the tips that may touch.
            enough_m: where at least this is certainly to spare, the distance is only bounded [m].
        """
        robot, other = pair
        margin_m = self._guard.margin_m
        enough_m += margin_m
        if other in self._guard.obstacles:
            found = to_obstacle(self._of(robot).whole, self._guard.obstacles[other], enough_m)
        else:
            found = between_bodies(self._of(robot).shaft, self._of(other).shaft, enough_m)
        return Nearest(robot, other, found, margin_m)

    def sampled(self, pair: Pair) -> Nearest:
        """The distance of one of `ClearanceGuard.sampled`.

        Of two robots that of a tip which may touch from the body of the other, of one robot that from itself.
        """
        robot, other = pair
        margin_m = self._guard.margin_m
        enough_m = margin_m + LOOK_AHEAD_M
        parts, others = self._of(robot), self._of(other)
        if robot == other:
            itself = to_itself(parts.whole, margin_m, enough_m)
            if itself.upper_m == np.inf and self._guard.asks_as_before:
                itself = Distance(np.inf, np.inf, 0.0)
            return Nearest(robot, other, itself, margin_m)
        free = [self._guard.arms[name].tip_free_m > 0.0 for name in pair]
        found = []
        if free[0]:
            found.append(Nearest(robot, other, between_bodies(parts.tip, others.shaft, enough_m), margin_m))
        if free[1]:
            found.append(Nearest(robot, other, between_bodies(parts.shaft, others.tip, enough_m), margin_m))
        if all(free):
            found.append(self._tips(robot, parts.tip, other, others.tip))
        return min(found, key=lambda each: each.spare_m)

    def _tips(self, robot: str, tip: Body, other: str, other_tip: Body) -> Nearest:
        """The distance of two tips that may touch, of their tip radii; in a plane they may not cross."""
        arms = (self._guard.arms[robot], self._guard.arms[other])
        width_m, depth_m = arms[0].tip_radius_m + arms[1].tip_radius_m, self._guard.tip_depth_m
        plane = all(arm.model.dimension == 2 for arm in arms)
        if not plane:
            # Half of the radii at most: so the centre lines stay apart, however thin the tips are.
            depth_m = min(depth_m, 0.5 * width_m)
        tip, other_tip = (
            replace(tip, radius_m=arms[0].tip_radius_m),
            replace(other_tip, radius_m=arms[1].tip_radius_m),
        )
        found = between_bodies(tip, other_tip)
        if plane and found.lower_m + width_m <= 0.0:
            across_m = crossed_m(tip, other_tip)
            if across_m > 0.0:
                found = Distance(-across_m - width_m, min(found.upper_m, -width_m), found.at_m)
        return Nearest(robot, other, found, -depth_m)

    def _of(self, name: str) -> ArmParts:
        if name not in self._parts:
            self._parts[name] = self._guard.parts_of(name, *self._configuration[name])
        return self._parts[name]


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
        tip_radius_m=(body.radius_mm if body.tip_radius_mm is None else body.tip_radius_mm) / MM_PER_M,
        speeds=body_speeds(model, len(robot.axis_names)),
    )


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
