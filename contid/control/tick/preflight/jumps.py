"""Whether the answers of a model to the targets of a path jump, or are decided by rounding.

A path that is too fast needs smaller steps when it is played more slowly. Where the answer that a model
prefers changes at once, as that of the straightest bends next to the axis of an arm, it does not: half of the
way has all of the step, however short it is.

On such an axis itself two answers are as good as each other, and the one that is followed grows out of
rounding within some ticks. A check of one of them states nothing about a run, so a second sequence of answers
whose seeds are disturbed is followed beside the first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.targets import Actuation, Target, Vec3

#: The way between the targets is halved this often, each time to the half with the larger step.
_HALVINGS: Final = 6
#: An answer jumps when the last part, 1/64 of the way, has this share of the whole step.
_SHARE: Final = 0.5
#: Disturbance of the seed of every tick, and difference at which two answers are not the same one, as shares
#: of the travel of an axis.
_DISTURBANCE: Final = 1e-9
_APART: Final = 1e-2


def jump_of(config: RobotConfig, before: Target, after: Target, goals: Sequence[Actuation]) -> int | None:
    """Index of the axis whose answer jumps furthest between two targets; None when none does.

    Args:
        config: of the robot.
        before: a target in the base frame.
        after: the target of the next tick.
        goals: the answers to both.
    """
    if before.tip_m is None or after.tip_m is None:
        return None
    whole = _step(config, *goals)
    if max(whole) == 0.0:
        return None
    axis = max(range(len(whole)), key=whole.__getitem__)
    begin, end = 0.0, 1.0
    low, high = goals
    for _ in range(_HALVINGS):
        middle = 0.5 * (begin + end)
        target = replace(after, tip_m=_between(before.tip_m, after.tip_m, middle))
        try:
            answer = config.model.inverse(target, low).actuation
        except ValueError:
            return None
        if _step(config, low, answer)[axis] >= _step(config, answer, high)[axis]:
            end, high = middle, answer
        else:
            begin, low = middle, answer
    return axis if _step(config, low, high)[axis] > _SHARE * whole[axis] else None


class Disturbed:
    """A second sequence of answers to the targets of a robot, from seeds that are disturbed a little.

    Args:
        config: of the robot.
        begin: the answer to the first target.
    """

    def __init__(self, config: RobotConfig, begin: Actuation) -> None:
        self._config = config
        self._answer = begin
        self._ticks = 0
        own = len(begin) - config.extra_axes
        self._travel = [each.upper - each.lower for each in config.limits[:own]]

    def parts(self, target: Target, goal: Actuation) -> bool:
        """True when the answer to the next target is another than ``goal``; then it goes on from there."""
        self._ticks += 1
        seed = [
            value + _DISTURBANCE * travel * math.sin(7.0 * axis + self._ticks)
            for axis, (value, travel) in enumerate(zip(self._answer, self._travel, strict=False))
        ]
        own = len(seed)
        try:
            self._answer = self._config.model.inverse(target, (*seed, *self._answer[own:])).actuation
        except ValueError:
            self._answer = goal
        apart = zip(self._answer, goal, self._travel, strict=False)
        if any(abs(a - b) > _APART * travel for a, b, travel in apart):
            self._answer = goal
            return True
        return False


def _step(config: RobotConfig, before: Actuation, after: Actuation) -> list[float]:
    """The step of every axis of the model, by what it can do in one tick."""
    return [abs(b - a) / each.step for a, b, each in zip(before, after, config.limits, strict=True)]


def _between(a: Vec3, b: Vec3, share: float) -> Vec3:
    x, y, z = (p + share * (q - p) for p, q in zip(a, b, strict=True))
    return x, y, z
