"""The way to an answer that the axes cannot reach in one tick: on a line of the tip, or of the axes.

Axes and their steps are in m, Pa or rad. The tip goes along a line (`contid.control.tick.ways.chord`) as far
as the model has answers on it; then the axes go on a straight line to the answer, which is free, because
limits of the model, such as a bend radius, are convex. The next step is the first that exists of:

1. to the answer of the model to the next point of the line of the tip, if the axes can stop after it;
2. along the line of the tip, if that does not leave the line at the end of an axis, with the same condition;
3. the same two with the tip braking on its line;
4. while axes move, they brake together;
5. along the line of the axes, with the same condition, or they brake together;
6. none, from rest.

Targets with a frame have 5 and 6 only, and so have others once their axes are on a straight line, until the
target jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import brake_step
from contid.control.tick.tip_task import between, displacement_of, jacobian_of, shifted, task_of, turned
from contid.control.tick.ways.chord import StraightLine
from contid.control.tick.ways.joint_steps import (
    ROUNDING,
    braked,
    feasible_part,
    stands,
    stop_ratio,
    unbounded_steps,
    within,
)
from contid.control.tick.ways.redundant import Redundant
from contid.kinematics.array import Array, pseudo_inverse
from contid.targets import Actuation, Pose, Solution, Target

#: Share of a step across the line, where an axis is at its end, that leaves the line.
_ACROSS: Final = 1e-3
#: Squares of lengths below this count as zero [m^2].
_TINY_M2: Final = 1e-24


class WayCommand(NamedTuple):
    """The next command of the model's axes, and whether it is on their line instead of that of the tip."""

    command: Array
    of_axes: bool


class Way:
    """From the last command to the answer, in the axes and in what the target asks for."""

    def __init__(
        self,
        config: RobotConfig,
        last: Actuation,
        answer: Actuation,
        answer_steps: Sequence[float],
        target: Target,
        extra: Actuation,
        low: Array,
        high: Array,
    ) -> None:
        self._config, self._target, self._extra = config, target, extra
        self._limits = limits = config.limits[: len(last)]
        self._low, self._high = low, high
        self._last, self._answer, self._paces = np.array(last), np.array(answer), np.array(answer_steps)
        self._redundant = _freedoms(config, target, len(last)) > 0
        self._before = self._answer  # the answer that goes along with the line, a tick ago
        self._to_answer: StraightLine | None = None  # line of the tip to the answer, as far as it moves
        self._task = None if target.tip_m is None else task_of(config, target, extra)
        if self._task is None:
            self._jumped = self._too_fast(self._paces)
            return
        lower, upper = (np.array(ends[: len(last)]) for ends in (config.model.lower, config.model.upper))
        self._here = here = self._task(self._last)
        self._J = jacobian_of(self._task, self._last, here, config.limits, 0.5 * (lower + upper))
        self._inverse = pseudo_inverse(self._J)
        displaced = displacement_of(self._task, self._last, here, target.direction is not None)
        goal = displaced(self._answer - self._last)
        drift = goal - displaced(self._answer - self._last - self._paces)
        needed = self._inverse @ drift
        self._jumped = self._too_fast(needed)
        drift = np.zeros(len(goal)) if self._jumped else drift
        self._part = part = 0.0 if self._jumped else feasible_part(needed, low, high)
        self._before = self._answer - part * self._paces
        self._goal, self._drift, self._displaced = goal, drift, displaced
        self._to_answer = StraightLine(limits, self._J, displaced, goal, drift)

    @cached_property
    def _chase(self) -> StraightLine | None:
        """The line of the tip to the answer, as far as axes that speed up can go along with it."""
        # Few frames between two are in reach, and the roll of an arm may take all of its travel.
        if self._task is None or self._target.rotation is not None:
            return None
        if self._part < 1.0:
            drift = self._part * self._drift
            return StraightLine(self._limits, self._J, self._displaced, self._goal, drift)
        return self._to_answer

    def _too_fast(self, paces: Array) -> bool:
        """True for an answer that goes further in a tick than an axis can: it has jumped."""
        return any(abs(pace) > each.step for pace, each in zip(paces.tolist(), self._limits, strict=True))

    def held(self, clipped: Array, exact_m: float) -> Array | None:
        """The next command of a redundant robot with the tip on its target; None if none was found."""
        on_target = self._to_answer is not None and self._to_answer.share >= 1.0
        if self._task is None or not on_target or not self._redundant:
            return None
        low, high = self._last + self._low, self._last + self._high
        redundant = Redundant(
            self._limits, low, high, self._task, self._here, self._J, self._inverse, exact_m
        )
        return redundant.held(self._last, self._answer, self._paces, clipped)

    def towards(self, last_steps: Array, straight: bool) -> WayCommand | None:
        """The next command towards the answer; None where the line of the axes is blocked.

        Args:
            last_steps: of the model's axes.
            straight: the axes are on their line.
        """
        if self._chase is not None and (self._jumped or not straight):
            step = self._step_of_tip(self._chase, last_steps)
            if step is not None:
                return WayCommand(self._last + step, of_axes=False)
        step = self._step_of_axes(last_steps)
        return None if step is None else WayCommand(self._last + step, of_axes=True)

    def _step_of_tip(self, chase: StraightLine, last_steps: Array) -> Array | None:
        """The next step on the line of the tip; None for axes at rest that cannot go on along it."""
        limits, low, high = self._limits, self._low, self._high
        moving = any(abs(d) > each.change for d, each in zip(last_steps.tolist(), limits, strict=True))
        preferred = self._preferred(chase)
        free_low, free_high = unbounded_steps(limits, last_steps)
        for halt in (False, True):
            step, share, across = chase.step(low, high, preferred, halt)
            if not moving and stands(limits, step):
                continue
            if across <= _ACROSS and share > 0.0:
                solved = self._solved_step(share)
                if solved is not None and (moving or not stands(limits, solved)):
                    return solved
            at_end = ((step <= low) & (low > free_low)) | ((step >= high) & (high < free_high))
            leaves_line = across > _ACROSS and at_end.any()
            if not leaves_line and self._can_stop(step):
                return step
        return braked(limits, last_steps, low, high) if moving else None

    def _step_of_axes(self, last_steps: Array) -> Array | None:
        """The next step on the straight line of the axes; None where it is blocked."""
        limits, low, high = self._limits, self._low, self._high
        scale, gap = np.array([each.step for each in limits]), self._answer - self._last
        drift = (0.0 if self._jumped else feasible_part(self._paces, low, high)) * self._paces
        line = StraightLine(limits, np.diag(1.0 / scale), lambda d: d / scale, gap / scale, drift / scale)
        step, _, _ = line.step(low, high, gap)
        if self._can_stop(step):
            return step
        return braked(limits, last_steps, low, high) if np.any(last_steps) else None

    def _preferred(self, chase: StraightLine) -> Array:
        """The step of redundant axes towards the answer to the next point of the line."""
        if not self._redundant:
            return np.zeros(len(self._last))
        gap = np.array(self._solved(chase.share).actuation[: len(self._last)]) - self._last
        part = 1.0
        for each, size in zip(self._limits, np.abs(gap).tolist(), strict=True):
            if size > ROUNDING * each.change:
                part = min(part, brake_step(size, each.change) / size)
        step: Array = part * gap
        return step

    def _solved_step(self, share: float) -> Array | None:
        """The step to the model's answer for a point of the line, if it is allowed and can be stopped."""
        solution = self._solved(share)
        step = np.array(solution.actuation[: len(self._last)]) - self._last
        slack = ROUNDING * (self._high - self._low)
        if not solution.converged or np.any(step < self._low - slack) or np.any(step > self._high + slack):
            return None
        step = np.clip(step, self._low, self._high)
        return step if self._can_stop(step) else None

    @cached_property
    def _ends(self) -> tuple[Pose, Pose, Pose]:
        """Poses at the last command, at the answer a tick ago and at the answer."""
        begin, before, end = (
            self._config.model.forward((*axes.tolist(), *self._extra), self._target.load_n)
            for axes in (self._last, self._before, self._answer)
        )
        return begin, before, end

    def _solved(self, share: float) -> Solution:
        """Answer of the model to a point of the line, which has moved along with the target."""
        target = self._target
        begin, before, end = self._ends
        away, drift = np.subtract(end.tip_m, begin.tip_m), np.subtract(end.tip_m, before.tip_m)
        # A direction has turned with the target by as much of its way as the tip has gone.
        along = float(np.clip(away @ drift / max(float(away @ away), _TINY_M2), 0.0, 1.0))
        point = replace(
            target,
            tip_m=between(shifted(begin.tip_m, before.tip_m, end.tip_m), end.tip_m, share),
            direction=None
            if target.direction is None
            else turned(begin.direction, end.direction, along + (1.0 - along) * share),
            mid_m=None
            if target.mid_m is None
            else between(shifted(begin.mid_m, before.mid_m, end.mid_m), end.mid_m, share),
            extra={},
        )
        return self._config.model.inverse(point, (*self._last.tolist(), *self._extra))

    def _can_stop(self, step: Array) -> bool:
        """True when the axes, after a step, can stop together before the limits of the model."""
        ahead = self._last + stop_ratio(self._limits, step) * step
        return within(self._config, tuple(ahead.tolist()), self._extra)


def _freedoms(config: RobotConfig, target: Target, axes: int) -> int:
    """How many axes more a robot has than a target asks for."""
    asked = 2 * (target.direction is not None) + 3 * (target.rotation is not None)
    return axes - config.model.dimension - asked - 3 * (target.mid_m is not None)
