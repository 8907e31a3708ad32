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
from contid.targets import Actuation, Target, Vec3, frame_of_axes, unit_vector, vec3

#: The way between the targets is halved this often, each time to the half with the larger step.
_HALVINGS: Final = 6
#: An answer jumps when the last part, 1/64 of the way, has this share of the whole step.
_SHARE: Final = 0.5
#: Disturbance of the seed of every tick, as a share of the travel of an axis.
_DISTURBANCE: Final = 1e-9
#: Phase of the disturbance from one axis to the next [rad]: no two axes are disturbed alike.
_PHASE: Final = 7.0
#: Difference at which two answers are not the same one, as a share of the travel of an axis.
_APART: Final = 1e-2


def jump_of(config: RobotConfig, before: Target, after: Target, goals: Sequence[Actuation]) -> int | None:
    """Index of the axis of the model whose answer jumps furthest between two targets; None when none does.

    Extra axes go where a target states, so they never jump.

    Args:
        config: of the robot.
        before: a target in the base frame.
        after: the target of the next tick.
        goals: the answer to ``before`` and that to ``after``, with the extra axes.
    """
    if before.tip_m is None or after.tip_m is None:
        return None
    whole = _steps(config, *goals)
    if max(whole) == 0.0:
        return None
    axis = max(range(len(whole)), key=whole.__getitem__)
    begin, end = 0.0, 1.0
    low, high = goals
    for _ in range(_HALVINGS):
        middle = 0.5 * (begin + end)
        try:
            answer = config.model.inverse(_target_between(before, after, middle), low).actuation
        except ValueError:
            return None
        if _steps(config, low, answer)[axis] >= _steps(config, answer, high)[axis]:
            end, high = middle, answer
        else:
            begin, low = middle, answer
    return axis if _steps(config, low, high)[axis] > _SHARE * whole[axis] else None


class Disturbed:
    """A second sequence of answers to the targets of a robot, from seeds that are disturbed a little.

    Args:
        config: of the robot.
        begin: the answer to the first target, with the extra axes; those are not disturbed.
    """

    def __init__(self, config: RobotConfig, begin: Actuation) -> None:
        self._config = config
        self._answer = begin
        self._ticks = 0
        own = len(begin) - config.extra_axes
        self._travel = [each.upper - each.lower for each in config.limits[:own]]

    def parts(self, target: Target, goal: Actuation) -> bool:
        """True when the second answer to the next target is not ``goal``, from which it then goes on."""
        self._ticks += 1
        seed = [
            value + _DISTURBANCE * travel * math.sin(_PHASE * axis + self._ticks)
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


def _steps(config: RobotConfig, before: Actuation, after: Actuation) -> list[float]:
    """The step of every axis of the model, by what it can do in one tick."""
    own = len(before) - config.extra_axes
    steps = zip(before[:own], after[:own], config.limits[:own], strict=True)
    return [abs(new - old) / each.step for old, new, each in steps]


def _target_between(before: Target, after: Target, share: float) -> Target:
    """The target of a tip at a share of the way; what only one of the two states is that of ``after``."""
    assert before.tip_m is not None
    assert after.tip_m is not None
    rotation = after.rotation
    if before.rotation is not None and rotation is not None and before.rotation != rotation:
        z, x = (_between(before.rotation[k::3], rotation[k::3], share) for k in (2, 0))
        rotation = frame_of_axes(z, x) or rotation
    direction = after.direction
    if before.direction is not None and direction is not None and before.direction != direction:
        direction = unit_vector(_between(before.direction, direction, share)) or direction
    mid_m = after.mid_m
    if before.mid_m is not None and mid_m is not None:
        mid_m = _between(before.mid_m, mid_m, share)
    return replace(
        after,
        tip_m=_between(before.tip_m, after.tip_m, share),
        direction=direction,
        rotation=rotation,
        mid_m=mid_m,
        load_n=_between(before.load_n, after.load_n, share),
    )


def _between(a: Sequence[float], b: Sequence[float], share: float) -> Vec3:
    return vec3([p + share * (q - p) for p, q in zip(a, b, strict=True)])
