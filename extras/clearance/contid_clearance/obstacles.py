"""Convex obstacles by their signed distance: negative inside, convex, with a Lipschitz constant of 1."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol

import numpy as np

from contid.kinematics.array import Array

_NO_ROTATION: Final = np.zeros(9)


class Obstacle(Protocol):
    """A convex set in the world frame."""

    @property
    def packed(self) -> Array:
        """The obstacle as the kernel ``clearance`` takes it, shape ``(17,)``.

        Kind (0 plane, 1 capsule, 2 box), point, vector, rotation (row-major), radius.
        """
        ...

    def signed_distance(self, points: Array) -> Array:
        """Distance of points ``(n, 3)`` in the world from the surface [m], negative inside; ``(n,)``."""
        ...


@dataclass(frozen=True, eq=False)
class Plane:
    """A half space: everything behind a plane.

    Attributes:
        point: a point on the plane [m].
        normal: unit vector that points out of the obstacle.
    """

    point: Array
    normal: Array

    def signed_distance(self, points: Array) -> Array:
        """Distance of points ``(n, 3)`` in the world from the surface [m], negative inside; ``(n,)``."""
        return np.asarray((points - self.point) @ self.normal)

    @cached_property
    def packed(self) -> Array:
        """The obstacle as the kernel ``clearance`` takes it, shape ``(17,)`` (`Obstacle`)."""
        return np.concatenate([[0.0], self.point, self.normal, _NO_ROTATION, [0.0]])


@dataclass(frozen=True, eq=False)
class Capsule:
    """A cylinder with round ends; a sphere when both ends are one point.

    Attributes:
        start, end: ends of its axis [m].
        radius_m: [m].
    """

    start: Array
    end: Array
    radius_m: float

    def signed_distance(self, points: Array) -> Array:
        """Distance of points ``(n, 3)`` in the world from the surface [m], negative inside; ``(n,)``."""
        axis, from_start = self.end - self.start, points - self.start
        squared = float(axis @ axis)
        along = np.zeros(len(points)) if squared == 0.0 else np.clip(from_start @ axis / squared, 0.0, 1.0)
        return np.asarray(np.linalg.norm(from_start - along[:, None] * axis, axis=1) - self.radius_m)

    @cached_property
    def packed(self) -> Array:
        """The obstacle as the kernel ``clearance`` takes it, shape ``(17,)`` (`Obstacle`)."""
        return np.concatenate([[1.0], self.start, self.end - self.start, _NO_ROTATION, [self.radius_m]])


@dataclass(frozen=True, eq=False)
class Box:
    """A box.

    Attributes:
        center: [m].
        rotation: box to world, shape ``(3, 3)``.
        half: half of its three sizes [m].
    """

    center: Array
    rotation: Array
    half: Array

    def signed_distance(self, points: Array) -> Array:
        """Distance of points ``(n, 3)`` in the world from the surface [m], negative inside; ``(n,)``."""
        over = np.abs((points - self.center) @ self.rotation) - self.half
        outside = np.linalg.norm(np.maximum(over, 0.0), axis=1)
        return np.asarray(outside + np.minimum(over.max(axis=1), 0.0))

    @cached_property
    def packed(self) -> Array:
        """The obstacle as the kernel ``clearance`` takes it, shape ``(17,)`` (`Obstacle`)."""
        return np.concatenate([[2.0], self.center, self.half, self.rotation.ravel(), [0.0]])
