"""A robot whose body is checked: its parts in the world, and how fast its points move at most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import mul
from typing import Final, NamedTuple

import numpy as np

from contid.kinematics.array import Array, polyline_length
from contid.kinematics.frames import BaseFrame, in_world
from contid.kinematics.model import Model
from contid.targets import Actuation, Vec3
from contid_clearance.body import Body, sampled_body

#: The greatest speed of a body is searched among this many actuations, and multiplied by the factor.
SPEED_SAMPLES: Final = 24
SPEED_FACTOR: Final = 1.5
_STEP: Final = 1e-3
_POINTS: Final = 17


def primes(count: int) -> list[int]:
    """The first primes: one base of `radical_inverse` per axis, of which a tendon robot may have 64."""
    found: list[int] = []
    number = 2
    while len(found) < count:
        if all(number % each for each in found):
            found.append(number)
        number += 1
    return found


def radical_inverse(index: int, base: int) -> float:
    """Van der Corput's sequence in [0, 1): digits of the index mirrored at the point (Halton 1960)."""
    value, scale = 0.0, 1.0 / base
    while index:
        index, digit = divmod(index, base)
        value += digit * scale
        scale /= base
    return value


class ArmParts:
    """A body in the world and its parts, each computed when it is needed first.

    Args:
        arm: the robot.
        whole: its backbone from the base on.
    """

    def __init__(self, arm: Arm, whole: Body) -> None:
        self._arm = arm
        self._backbone = whole
        self._length_m = whole.pieces * whole.spacing_m
        self._cut_m = max(self._length_m - arm.tip_free_m, arm.from_m)

    @cached_property
    def whole(self) -> Body:
        """From where the body begins to the tip."""
        return self._backbone.part(self._arm.from_m, self._length_m)

    @cached_property
    def shaft(self) -> Body:
        """The part that may not touch other robots."""
        return self._backbone.part(self._arm.from_m, self._cut_m)

    @cached_property
    def tip(self) -> Body:
        """The part that may touch the tips of other robots."""
        return self._backbone.part(self._cut_m, self._length_m)


class BodySpeeds(NamedTuple):
    """How fast a body moves and changes its form at most, per change of each axis; 0 for extra axes.

    Attributes:
        of_points: motion of a point of the body [m/m or m/Pa].
        of_distances: change of the distance between two points of the body, and of its length. A body that
            turns as a whole moves and keeps them.
    """

    of_points: tuple[float, ...]
    of_distances: tuple[float, ...]


class Motion(NamedTuple):
    """Bounds of a motion of a robot.

    Attributes:
        way_m: of the way of every point of its body [m].
        change_m: of the change of the distance of any two of them, and of its length [m].
    """

    way_m: float
    change_m: float


#: A robot that stands.
NO_MOTION: Final = Motion(0.0, 0.0)


@dataclass(frozen=True, eq=False, slots=True)
class Arm:
    """A robot whose body is checked.

    Attributes:
        name: name in the robot file.
        model: kinematics, with the extra axes.
        frame: its base in the world.
        radius_m: radius of its body [m].
        from_m: where the body begins [m].
        tip_free_m: length at the tip that may touch the tips of other robots [m].
        tip_radius_m: radius of that length against those tips [m].
        speeds: per change of each axis [m/m or m/Pa].
    """

    name: str
    model: Model
    frame: BaseFrame
    radius_m: float
    from_m: float
    tip_free_m: float
    tip_radius_m: float
    speeds: BodySpeeds

    def parts(self, actuation: Actuation, load_n: Vec3) -> ArmParts:
        """The body and its parts in the world, under a known force on the tip in the world."""
        load = self.frame.vector_in_base(load_n)

        def curve(count: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
            return in_world(self.frame, self.model.shape(actuation, count, load))

        return ArmParts(self, sampled_body(curve, self.radius_m))

    def motion_m(self, before: Actuation, after: Actuation) -> float:
        """Bound of the motion of every point of the body between two actuations [m]."""
        return sum([k * abs(b - a) for k, a, b in zip(self.speeds.of_points, before, after, strict=True)])

    def motion(self, ways: Sequence[float]) -> Motion:
        """Bounds of what changes while the axes go ways of these lengths [m or Pa]."""
        of_points, of_distances = self.speeds
        return Motion(sum(map(mul, of_points, ways)), sum(map(mul, of_distances, ways)))


def body_speeds(model: Model, own_axes: int) -> BodySpeeds:
    """How fast a body moves and changes its form at most.

    Differences at `SPEED_SAMPLES` actuations, times `SPEED_FACTOR`: an estimate, not a proof.
    """
    low, high = np.array(model.lower[:own_axes]), np.array(model.upper[:own_axes])
    rest = model.lower[own_axes:]
    greatest = np.zeros((2, own_axes))
    bases = primes(own_axes)
    for k in range(1, SPEED_SAMPLES + 1):
        part = np.array([radical_inverse(k, base) for base in bases])
        actuation = low + (high - low) * (_STEP + (1.0 - 2.0 * _STEP) * part)
        points = model.shape((*actuation.tolist(), *rest), _POINTS)
        for axis in range(own_axes):
            moved = actuation.copy()
            moved[axis] += _STEP * (high - low)[axis]
            moved_points = model.shape((*moved.tolist(), *rest), _POINTS)
            motion = float(np.max(np.linalg.norm(moved_points - points, axis=1)))
            change = float(np.max(np.abs(_distances(moved_points) - _distances(points))))
            longer = abs(polyline_length(moved_points) - polyline_length(points))
            step = _STEP * float((high - low)[axis])
            greatest[:, axis] = np.maximum(greatest[:, axis], (motion / step, (change + longer) / step))
    extra = (0.0,) * len(rest)
    return BodySpeeds(*((*each, *extra) for each in (SPEED_FACTOR * greatest).tolist()))


def _distances(points: Array) -> Array:
    """Distances of all points from each other, shape ``(points, points)`` [m]."""
    return np.asarray(np.linalg.norm(points[:, None] - points, axis=2))
