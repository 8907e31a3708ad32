"""Coordinates in which a path is led, and the limits that its commands keep in them.

Pressures are led themselves. Pulls of tendons have corners where another tendon becomes the least tight of
its section, so bends are led instead, which are smooth: the pulls for them keep every tendon at its floor of
tension or above. Both have convex limits: planes, and cones of bends as the planes that touch them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.model import Model
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.robot import RobotDescription

#: What a change of coordinates costs beside the way of the tip that it leads to, as a share of the greatest
#: such way: changes that do not move the tip are small too, and have one answer.
_STILL: Final = 0.05
#: A limit acts where it is exceeded by more than this share of the greatest bound.
_INSIDE: Final = 1e-9
#: How often the planes that touch cones are looked for again where a row is led back to them.
_TOUCHES: Final = 30


class Planes(NamedTuple):
    """Limits ``normals x <= offsets``."""

    normals: Array
    offsets: Array


class Coordinates(Protocol):
    """What is led: coordinates x of the actuation."""

    def of(self, actuations: Array) -> Array:
        """Coordinates ``(rows, n)`` of actuations ``(rows, axes)``."""

    def actuations(self, rows: Array) -> Array:
        """Actuations ``(rows, axes)`` of coordinates ``(rows, n)``."""

    def tip_slope(self, row: Array) -> Array:
        """Derivative of the tip by the coordinates, ``(3, n)``."""

    def limits(self, row: Array, before: Array | None) -> Planes:
        """Limits about a row, after the row of the command before."""


@dataclass(frozen=True)
class Pressures:
    """Axes as they are.

    Attributes:
        model: of the robot.
        low, high: of the axes.
        step: greatest change between two commands.
    """

    model: Model
    low: Array
    high: Array
    step: Array

    def of(self, actuations: Array) -> Array:
        """See `Coordinates`."""
        return actuations

    def actuations(self, rows: Array) -> Array:
        """See `Coordinates`."""
        return np.clip(rows, self.low, self.high)

    def tip_slope(self, row: Array) -> Array:
        """See `Coordinates`."""
        return self.model.jacobian(tuple(row.tolist()))

    def limits(self, row: Array, before: Array | None) -> Planes:
        """See `Coordinates`."""
        low, high = self.low, self.high
        if before is not None:
            low, high = np.maximum(low, before - self.step), np.minimum(high, before + self.step)
        one = np.eye(len(row))
        return Planes(np.vstack((one, -one)), np.concatenate((high, -low)))


@dataclass(frozen=True)
class Bends:
    """Bends of the sections of a tendon robot, times their length [m].

    Attributes:
        model: of the robot.
    """

    model: TendonModel

    def of(self, actuations: Array) -> Array:
        """See `Coordinates`."""
        bends = np.array([self.model.bends(row) for row in actuations])
        return np.asarray(bends * self._lengths)

    def actuations(self, rows: Array) -> Array:
        """See `Coordinates`."""
        sections = self.model.feasible.sections.backbone_m
        arcs = np.zeros((len(rows), len(sections), 3))
        arcs[:, :, :2] = (rows / self._lengths).reshape(len(rows), -1, 2)
        found = [self.model.of_arcs(each, self.model.lower) for each in arcs.reshape(len(rows), -1).tolist()]
        return np.asarray(np.clip(np.array(found), self.model.lower, self.model.upper))

    def tip_slope(self, row: Array) -> Array:
        """See `Coordinates`."""
        tip, spin, mid = np.empty((3, 3, len(row)))
        self.model.solver.differentiate(tuple(row.tolist()), tip, spin, mid)
        return np.asarray(tip)

    def limits(self, row: Array, before: Array | None) -> Planes:
        """See `Coordinates`."""
        feasible = self.model.feasible
        pairs = row.reshape(-1, 2)
        size = np.maximum(np.hypot(*pairs.T), 1e-12)
        touching = np.zeros((len(pairs), len(row)))
        for k, (along, length) in enumerate(zip(pairs, size, strict=True)):
            touching[k, 2 * k : 2 * k + 2] = along / length
        cones = np.array(feasible.sections.backbone_m) * np.array(feasible.bend_max_rad)
        return Planes(np.vstack((feasible.normals, touching)), np.concatenate((feasible.offsets, cones)))

    @property
    def _lengths(self) -> Array:
        return np.repeat(self.model.feasible.sections.backbone_m, 2)


class HeldRows(NamedTuple):
    """Coordinates within the limits.

    Attributes:
        rows: one per command, ``(ticks, n)``.
        ticks: at how many of them a limit acts.
    """

    rows: Array
    ticks: int


def coordinates_of(robot: RobotDescription, model: Model, period_s: float) -> Coordinates:
    """In which a robot is led.

    Args:
        robot: description of the robot.
        model: of it.
        period_s: between two commands.
    """
    # A subclass has other pulls for the same bends, such as those under its own weight.
    if type(model) is TendonModel:
        return Bends(model)
    axes = len(robot.axis_names)
    step = period_s * np.array(robot.rate_limits[0][:axes])
    return Pressures(model, np.array(model.lower), np.array(model.upper), step)


def held(coordinates: Coordinates, path: Array, wished: Array) -> HeldRows:
    """The rows within the limits that move the tip least away from what the wished rows ask for.

    One row after the other: of all changes d that keep the limits the one with the least ``|J d|^2 + e^2
    |d|^2``, where J is the slope of the tip at the path. Where no limit acts d is 0. Pressures of which one
    would be negative rise together, since that bends nothing.

    Args:
        coordinates: of the robot.
        path: coordinates of the path.
        wished: what leads it, as many rows or more.

    Raises:
        ValueError: ``wished`` has numbers that are not finite.
    """
    if not np.isfinite(wished).all():
        raise ValueError("wished: finite numbers are expected")
    rows, ticks = wished.copy(), 0
    before: Array | None = None
    for k, row in enumerate(rows):
        planes = coordinates.limits(row, before)
        if _exceeded(planes, row).any():
            slope = coordinates.tip_slope(path[min(k, len(path) - 1)])
            row += _change(coordinates, planes, slope, row, before)
            ticks += 1
        before = row
    return HeldRows(rows, ticks)


def _exceeded(planes: Planes, row: Array) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Which planes a row is beyond."""
    inside: Array = planes.normals @ row - planes.offsets
    return np.asarray(inside > _INSIDE * np.abs(planes.offsets).max(), dtype=np.bool_)


def _change(
    coordinates: Coordinates, planes: Planes, slope: Array, wished: Array, before: Array | None
) -> Array:
    """The d of `held` of one row.

    A plane touches a cone where the row is, so another one may be exceeded where it is led to: it is added,
    until none is. Each is a limit of every row within the cone (J. E. Kelley, "The Cutting-Plane Method for
    Solving Convex Programs", 1960).
    """
    for _ in range(_TOUCHES):
        change = _least_change(slope, planes.normals, planes.offsets - planes.normals @ wished)
        found = coordinates.limits(wished + change, before)
        beyond = _exceeded(found, wished + change)
        if not beyond.any():
            break
        planes = Planes(
            np.vstack((planes.normals, found.normals[beyond])),
            np.concatenate((planes.offsets, found.offsets[beyond])),
        )
    return change


def _least_change(slope: Array, normals: Array, room: Array) -> Array:
    """The d of `held`, as a problem of least distance.

    Source: C. L. Lawson and R. J. Hanson, "Solving Least Squares Problems", 1974, chapter 23.
    """
    from scipy.optimize import nnls

    count = slope.shape[1]
    still = float(_STILL * np.linalg.norm(slope, 2)) ** 2 * np.eye(count)
    root = np.linalg.cholesky(slope.T @ slope + still).T
    turned = -np.linalg.solve(root.T, normals.T)
    size = np.maximum(np.linalg.norm(turned, axis=0), 1e-300)
    scale = max(float(np.abs(room / size).max()), 1e-300)
    both = np.vstack((turned / size, (-room / size / scale)[None, :]))
    last = np.append(np.zeros(count), 1.0)
    rest = both @ nnls(both, last)[0] - last
    return np.asarray(np.linalg.solve(root, -scale * rest[:-1] / rest[-1]))
