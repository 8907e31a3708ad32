"""Commands under the limits of the axes that keep the tip on its target: redundant motion waits instead.

A redundant arm moves its axes in two parts: what its tip needs, and what brings the axes to the preferred of
all solutions. Where a limit binds, the second part is scaled by one share for all axes, the greatest from
which they can brake together; the first stays whole. Axes that are at their bound of this tick stop
there and the others take their part, after F. Flacco, A. De Luca, O. Khatib, "Control of Redundant Robots
Under Hard Joint Constraints: Saturation in the Null Space", IEEE Trans. Robotics 31(3), 2015.

Where no command within the limits has its tip on target (a jump, a path that is too fast), every axis goes
towards its answer by itself (`contid.control.tick.limits`) and the tip lags.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import AxisLimits, allowed_steps, brake_step, limit
from contid.kinematics.array import Array
from contid.robot_file.base import Quantity
from contid.targets import Actuation, Pose, Target, Vec3

#: A command is on its target when its tip is no farther off than this [m]: by rounding for racks and tubes,
#: by the error of the statics for rods.
_TOLERANCE_M: Final = {Quantity.LENGTH: 1e-9, Quantity.PRESSURE: 5e-5}
#: Length that a radian of direction counts as [m].
_ELL_M: Final = 0.1
#: Error of a command that is on target, as a share of the tolerance.
_EXACT: Final = 1e-3
_STEPS: Final = 8
#: Redundant motion of an axis that is none, as a share of its greatest change of step.
_NONE: Final = 1e-6
#: Axis moves of the finite differences, as a share of the travel.
_SHARE: Final = 1e-6

_Task: TypeAlias = Callable[[Array], Array]


def tip_tolerance_m(quantity: Quantity) -> float:
    """Greatest distance of the commanded tip from its target on a path that is followed [m]."""
    return _TOLERANCE_M[quantity]


def limit_on_path(
    config: RobotConfig,
    last: Actuation,
    last_steps: Actuation,
    answer: Actuation,
    answer_steps: Sequence[float],
    target_in_base: Target,
) -> tuple[Actuation, tuple[int, ...]]:
    """Next command of every axis of a robot that follows targets, and per axis the limits that bound.

    Args:
        config: of the robot.
        last: the last command.
        last_steps: the last command minus the one before.
        answer: of the model to the target.
        answer_steps: how far the answer moved in this tick.
        target_in_base: what it answers.
    """
    command, flags = limit(config.limits, last, last_steps, answer, answer_steps)
    own = len(command) - config.extra_axes
    if command[:own] == answer[:own] or target_in_base.tip_m is None or not all(map(math.isfinite, answer)):
        return command, flags
    freedoms = own - config.model.dimension
    freedoms -= 2 * (target_in_base.direction is not None) + 3 * (target_in_base.mid_m is not None)
    if freedoms <= 0:
        return command, flags
    limits = config.limits[:own]
    steps = [allowed_steps(each, *at) for each, *at in zip(limits, last, last_steps, strict=False)]
    low, high = (np.array(last[:own]) + np.array(side) for side in zip(*steps, strict=True))
    task = _task_of(config, target_in_base, command[own:])
    redundant = _Redundant(limits, low, high, task, _EXACT * _TOLERANCE_M[config.quantity])
    middle = 0.5 * (np.array(config.model.lower[:own]) + np.array(config.model.upper[:own]))
    held = redundant.held(
        np.array(last[:own]),
        np.array(answer[:own]),
        np.array(answer_steps[:own]),
        np.array(command[:own]),
        middle,
    )
    return command if held is None else (*held.tolist(), *command[own:]), flags


@dataclass(frozen=True)
class _Redundant:
    """The next command of a redundant robot within the bounds of this tick.

    Attributes:
        limits: of the axes.
        low, high: commands that they allow in this tick.
        task: what the target asks for, of a command [m].
        exact_m: error of the task at which a command is on target.
    """

    limits: Sequence[AxisLimits]
    low: Array
    high: Array
    task: _Task
    exact_m: float

    def held(
        self, last: Array, answer: Array, answer_steps: Array, clipped: Array, middle: Array
    ) -> Array | None:
        """A command with the tip where the answer has it, near a shared step; None if none was found."""
        goal = self.task(answer)
        J = self._jacobian(last, middle)
        needed = np.linalg.pinv(J) @ (goal - self.task(last))
        freely = self._braked(answer - last - needed, answer_steps - needed)
        shared = last + needed + self._share(freely, last + needed) * freely
        for begin in (shared, clipped):
            at = np.clip(begin, self.low, self.high)
            for _ in range(_STEPS):
                error = goal - self.task(at)
                if float(np.linalg.norm(error)) <= self.exact_m:
                    return at
                step = _bounded(J, error, self.low - at, self.high - at)
                at = np.clip(at + step, self.low, self.high)
        return None

    def _jacobian(self, at: Array, middle: Array) -> Array:
        """Forward differences of the task, towards the middle of each travel; shape ``(rows, axes)``."""
        here = self.task(at)
        columns = []
        for k, each in enumerate(self.limits):
            moved = at.copy()
            moved[k] += math.copysign(_SHARE * (each.upper - each.lower), middle[k] - at[k])
            columns.append((self.task(moved) - here) / (moved[k] - at[k]))
        return np.stack(columns, axis=1)

    def _braked(self, gap: Array, pace: Array) -> Array:
        """The redundant step along with the answer that closes what all axes can brake from."""
        closing, share = gap - pace, 1.0
        for each, size in zip(self.limits, np.abs(closing).tolist(), strict=True):
            if size > _NONE * each.change:
                share = min(share, brake_step(size, each.change) / size)
        step: Array = pace + share * closing
        return step

    def _share(self, freely: Array, needed: Array) -> float:
        """Greatest share, at most 1, of the redundant step that the bounds allow for all axes.

        Negative where axes that move the other way have to brake first.
        """
        least, most = -math.inf, 1.0
        for each, change, at, low, high in zip(
            self.limits, freely.tolist(), needed.tolist(), self.low.tolist(), self.high.tolist(), strict=True
        ):
            if abs(change) > _NONE * each.change:
                ends = sorted(((low - at) / change, (high - at) / change))
                least, most = max(least, ends[0]), min(most, ends[1])
        return most if least <= most else 1.0


def _task_of(config: RobotConfig, target: Target, extra: Actuation) -> _Task:
    """The rows of a target that a pose must meet [m], as a function of the model's own axes."""

    def rows(pose: Pose) -> tuple[Vec3, ...]:
        asked = [pose.tip_m]
        if target.direction is not None:
            x, y, z = pose.direction
            asked.append((_ELL_M * x, _ELL_M * y, _ELL_M * z))
        if target.mid_m is not None:
            asked.append(pose.mid_m)
        return tuple(asked)

    forward = config.model.forward
    return lambda own: np.array(rows(forward((*own.tolist(), *extra), target.load_n))).ravel()


def _bounded(J: Array, error: Array, low: Array, high: Array) -> Array:
    """A short step with ``J d = error`` inside bounds: axes beyond their bound stop there, worst first."""
    d = np.zeros(J.shape[1])
    free = np.ones(len(d), dtype=bool)
    for _ in range(len(d)):
        d[free] = np.linalg.pinv(J[:, free]) @ (error - J[:, ~free] @ d[~free])
        beyond = np.maximum(low - d, d - high)
        beyond[~free] = 0.0
        worst = int(np.argmax(beyond))
        if beyond[worst] <= 0.0:
            break
        d[worst] = min(max(d[worst], low[worst]), high[worst])
        free[worst] = False
        if not free.any():
            break
    return d
