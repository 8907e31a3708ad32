"""What a target asks for as a function of the axes: rows for tip, direction or frame, and mid-point."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import numpy as np

from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import AxisLimits
from contid.control.tick.ways.chord import Displacement
from contid.kinematics.array import Array, size_of
from contid.targets import Actuation, Pose, Target, Vec3, vec3

#: Length that a radian of direction counts as [m].
_ELL_M: Final = 0.1
#: Axis moves of the finite differences, as a share of the travel.
_MOVE_SHARE: Final = 1e-6
#: Angle from which the axis of a rotation is taken from its symmetric part [rad].
_NEAR_HALF_TURN: Final = 3.1
#: Sine of the angle below which two directions more than a right angle apart count as opposite.
_OPPOSITE: Final = 1e-9

#: From the model's own axes to the rows of a target [m].
Task: TypeAlias = Callable[[Array], Array]


def task_of(config: RobotConfig, target: Target, extra: Actuation) -> Task:
    """The rows of a target that a pose must meet [m], as a function of the model's own axes.

    Three rows each, in this order: the tip, its direction or its turn from the frame of the target (radians
    count as `_ELL_M`), and the mid-point. A target has a direction, a frame, or neither.

    Args:
        config: of the robot.
        target: in the base frame.
        extra: values of the axes beyond those of the model [m or rad].
    """
    goal = None if target.rotation is None else np.reshape(target.rotation, (3, 3))

    def rows(pose: Pose) -> tuple[Vec3, ...]:
        asked = [pose.tip_m]
        if target.direction is not None:
            x, y, z = pose.direction
            asked.append((_ELL_M * x, _ELL_M * y, _ELL_M * z))
        if goal is not None:
            asked.append(turn_of(goal.T @ np.reshape(pose.rotation, (3, 3)), _ELL_M))
        if target.mid_m is not None:
            asked.append(pose.mid_m)
        return tuple(asked)

    forward = config.model.forward
    return lambda own: np.array(rows(forward((*own.tolist(), *extra), target.load_n))).ravel()


def jacobian_of(task: Task, at: Array, here: Array, limits: Sequence[AxisLimits], middle: Array) -> Array:
    """Forward differences of the task, towards the middle of each travel; shape ``(rows, axes)``.

    Args:
        task: rows of the target.
        at: axes.
        here: the task there.
        limits: of the axes.
        middle: of their travels.
    """
    columns = []
    for k in range(len(at)):
        moved = at.copy()
        moved[k] += math.copysign(_MOVE_SHARE * (limits[k].upper - limits[k].lower), middle[k] - at[k])
        columns.append((task(moved) - here) / (moved[k] - at[k]))
    return np.stack(columns, axis=1)


def displacement_of(task: Task, last: Array, begin: Array, directed: bool) -> Displacement:
    """Change of the rows of a target [m] by a step of the axes.

    Args:
        task: rows of the target.
        last: axes at the last command, from which a step counts.
        begin: the task there.
        directed: the target has a direction; the change of its rows 3 to 5 is then the vector of the turn.
    """

    def of(step: Array) -> Array:
        change: Array = task(last + step) - begin
        if directed:
            change[3:6] = _ELL_M * _turn(begin[3:6] / _ELL_M, change[3:6] / _ELL_M)
        return change

    return of


def _turn(direction: Array, change: Array) -> Array:
    """Tangent of the great circle from a direction to a changed one, as long as the angle [rad].

    Every great circle leads to the opposite direction: taken is the one that turns about z, so that a
    direction of a plane stays in it, and from the z axis the one through x.
    """
    across = change - direction * float(direction @ change)
    sine = size_of(across)
    angle = math.atan2(sine, 1.0 + float(direction @ change))
    if sine < _OPPOSITE and angle > 0.5 * math.pi:
        x, y, _ = direction.tolist()
        flat = math.hypot(x, y)
        return math.pi * np.array((-y / flat, x / flat, 0.0) if flat > 0.0 else (1.0, 0.0, 0.0))
    return across * (angle / sine if sine > 0.0 else 1.0)


def shifted(point: Vec3, begin: Vec3, end: Vec3) -> Vec3:
    """A point moved by as much as ``end`` is from ``begin``."""
    return vec3(p + e - b for p, b, e in zip(point, begin, end, strict=True))


def turned(begin: Vec3, end: Vec3, share: float) -> Vec3:
    """The direction at a share of the great circle, 0 at ``begin`` and 1 at ``end``."""
    start = np.array(begin)
    turn = share * _turn(start, np.array(end) - start)
    angle = size_of(turn)
    if not angle > 0.0:
        return begin
    return vec3((math.cos(angle) * start + math.sin(angle) / angle * turn).tolist())


def turn_of(rotation: Array, size: float = 1.0) -> Vec3:
    """Axis of a rotation ``(3, 3)``, as long as its angle [rad] times ``size``."""
    r = rotation
    across = 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    sine = size_of(across)
    angle = math.atan2(sine, 0.5 * (float(np.trace(r)) - 1.0))
    if angle > _NEAR_HALF_TURN:  # the antisymmetric part vanishes; the symmetric one has the axis
        columns = 0.5 * (r + r.T) - math.cos(angle) * np.eye(3)
        axis = columns[:, int(np.argmax(np.diag(columns)))]
        axis = axis / size_of(axis)
        across = axis if float(axis @ across) >= 0.0 else -axis
        sine = 1.0
    return vec3((across * (size * (angle / sine if sine > 0.0 else 1.0))).tolist())


def between(begin: Vec3, end: Vec3, share: float) -> Vec3:
    """The point at a share of the straight line, 0 at ``begin`` and 1 at ``end``."""
    return vec3(a + share * (b - a) for a, b in zip(begin, end, strict=True))
