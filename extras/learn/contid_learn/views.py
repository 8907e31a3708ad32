"""What a policy sees of a robot, and what its actions mean; the same in an environment and on a robot.

The observation of a robot with n axes whose tip moves in d dimensions, in this order:

| numbers | what |
|---|---|
| n | measured axes, -1 and 1 at their limits |
| n | axes that the policy asked for last, likewise |
| d | tip, as a share of `RobotView.size` |
| d | from the tip to the goal, likewise |
| d | velocity of the goal, `RobotView.size` per second |

The tip is that of a tracker where there is one, else that of the model at the measured axes. An action has
one number from -1 to 1 per axis: the share of its greatest velocity with which it goes on. The target it
leads to stays within the limits of the axes. An action with a number that is not finite leaves the target of
its robot where it is, and one whose row is refused leaves those of all: robots hold.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid import Robot
from contid.errors import ContidError
from contid.kinematics.array import Array

Observation: TypeAlias = NDArray[np.float32]
#: Bounds of every number of an observation; what is seen beyond them is cut off.
BOUND: Final = 4.0
#: Poses that are looked at for the size of a robot and for its goals.
POSES: Final = 256


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """One robot as it was seen; units of its robot file.

    Attributes:
        measured: axes, shape ``(n,)``.
        tip: shape ``(d,)``.
    """

    measured: Array
    tip: Array


@dataclass(frozen=True, slots=True, eq=False)
class TipGoal:
    """Where the tip of one robot is to be; units of its robot file.

    Attributes:
        tip: shape ``(d,)``.
        velocity: per second, shape ``(d,)``.
    """

    tip: Array
    velocity: Array


class RobotView:
    """One robot of a file, as a policy sees and moves it.

    Args:
        robot: of the file.
        rate_hz: actions per second.
        prefix: the file has several robots, and columns begin with their names.

    Attributes:
        robot: its kinematics.
        name: of the robot.
        columns: of a row that moves it: ``left_mm`` (with several robots ``left.left_mm``).
        reachable: tips, shape ``(k, d)``, and the axes there, shape ``(k, n)``: what goals are made of.
        size: greatest extent of the tips along an axis of the world.
        velocity: greatest of an axis, per s.
    """

    def __init__(self, robot: Robot, rate_hz: float, prefix: bool) -> None:
        limits = robot.limits
        self.robot, self.name = robot, robot.name
        self.columns = tuple(f"{robot.name}.{axis}" if prefix else axis for axis in robot.axes)
        self.dimension = robot.dimension
        self.low, self.high = limits.min, limits.max
        self.velocity = limits.velocity
        self._step = limits.velocity / rate_hz
        # A robot file is refused unless the upper limit of every axis is above its lower one.
        self._scale = 2.0 / (self.high - self.low)
        self.reachable = _reachable(robot)
        self.size = float(np.ptp(self.reachable.tips, axis=0).max())

    @property
    def width(self) -> int:
        """Numbers of its observation."""
        return 2 * len(self.columns) + 3 * self.dimension

    def observed(self, seen: Seen, asked: Array, goal: TipGoal) -> Array:
        """Its part of the observation; ``asked`` are the axes that were asked for last."""
        place, of_size = seen.tip / self.size, 1.0 / self.size
        ahead, onward = goal.tip * of_size - place, goal.velocity * of_size
        return np.concatenate((self._centred(seen.measured), self._centred(asked), place, ahead, onward))

    def after(self, asked: Array, action: Array) -> Array:
        """The axes to ask for after an action."""
        if not np.isfinite(action).all():
            return asked
        # `np.clip` takes three times as long as its two halves.
        moved = asked + self._step * np.minimum(np.maximum(action, -1.0), 1.0)
        return np.minimum(np.maximum(moved, self.low), self.high)

    def begin(self, measured: Array) -> Array:
        """The axes to ask for before the first action: where the robot is."""
        begun: Array = np.clip(measured, self.low, self.high)
        return begun

    def distance(self, seen: Seen, goal: TipGoal) -> float:
        """From tip to goal, in the unit of lengths of the file."""
        return math.dist(goal.tip, seen.tip)

    def _centred(self, axes: Array) -> Array:
        return (axes - self.low) * self._scale - 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Reachable:
    """Tips and the axes there."""

    tips: Array
    axes: Array


def _reachable(robot: Robot) -> Reachable:
    """Tips spread over the axes of a robot, which its inverse kinematics reaches; the same every time.

    The axes of a goal are those that the inverse kinematics finds for the tip, not the drawn ones: with
    redundant axes both have the same tip. Tips for which it finds none are left out.
    """
    limits = robot.limits
    drawn = np.random.default_rng(0).uniform(limits.min, limits.max, (POSES, len(robot.axes)))
    found = robot.ik(robot.fk(drawn).tip)
    good = found.converged
    if not good.any():
        raise ContidError(f"{robot.name}: no pose inside its limits was found; `contid check` shows why")
    actuation = found.actuation[good]
    return Reachable(robot.fk(actuation).tip, actuation)


def views_of(robots: Robot, rate_hz: float) -> tuple[RobotView, ...]:
    """The robots of a file in its order."""
    names = robots.names
    return tuple(RobotView(robots[name], rate_hz, prefix=len(names) > 1) for name in names)


def observation(
    views: Sequence[RobotView],
    seen: Mapping[str, Seen],
    asked: Mapping[str, Array],
    goals: Mapping[str, TipGoal],
) -> Observation:
    """What a policy gets: the robots one after the other, shape ``(m,)``."""
    parts = [view.observed(seen[view.name], asked[view.name], goals[view.name]) for view in views]
    whole = np.concatenate(parts) if len(parts) > 1 else parts[0]
    if not math.isfinite(whole.sum()):
        whole = np.nan_to_num(whole, nan=0.0, posinf=BOUND, neginf=-BOUND)
    return np.minimum(np.maximum(whole, -BOUND), BOUND).astype(np.float32)


def asked_after(views: Sequence[RobotView], asked: Mapping[str, Array], action: Array) -> dict[str, Array]:
    """The axes of all robots to ask for after an action; each robot takes its part of it.

    Raises:
        ContidError: the action has another number of axes.
    """
    axes = sum([len(view.columns) for view in views])
    if action.shape != (axes,):
        raise ContidError(f"an action of shape {action.shape}; these robots take {(axes,)}")
    after, at = {}, 0
    for view in views:
        end = at + len(view.columns)
        after[view.name] = view.after(asked[view.name], action[at:end])
        at = end
    return after


def row_of(views: Sequence[RobotView], asked: Mapping[str, Array]) -> dict[str, float]:
    """The row of a live stream that asks for axes."""
    return {
        column: value
        for view in views
        for column, value in zip(view.columns, asked[view.name].tolist(), strict=True)
    }
