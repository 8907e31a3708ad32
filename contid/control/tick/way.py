"""The way from the last command to an answer that the axes cannot reach in one tick.

The tip goes along a line (`contid.control.tick.chord`) as far as the model has answers on it. A command is
taken only if the axes, or the tip on its line, can stop after it before a limit of the model, such as a
bend radius. Where that ends the line, the arm brakes on it, redundant axes may make room, and then the axes
go on a straight line to the answer: limits are convex, so that one is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np

from contid.control.tick.chord import StraightLine
from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import AxisLimits, brake_step
from contid.control.tick.redundant import Redundant
from contid.control.tick.tip_task import between, displacement_of, jacobian_of, shifted, task_of, turned
from contid.kinematics.array import Array, pseudo_inverse
from contid.targets import Actuation, Pose, Solution, Target

#: Share of a step across the line, where an axis is at its end, that leaves the line.
_ACROSS: Final = 1e-3
#: A step below this share of the greatest change of a step counts as rest.
_REST: Final = 1e-2
#: Squares of lengths below this count as zero [m^2].
_TINY_M2: Final = 1e-24
#: Differences of axes that are rounding, as a share of a step.
_NONE: Final = 1e-6


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
        self._config = config
        self._target = target
        self._extra = extra
        self._limits = limits = config.limits[: len(last)]
        self._low, self._high = low, high
        self._last = np.array(last)
        self._answer = np.array(answer)
        self._paces = np.array(answer_steps)
        middle = 0.5 * (np.array(config.model.lower[: len(last)]) + np.array(config.model.upper[: len(last)]))
        freedoms = len(last) - config.model.dimension
        freedoms -= 2 * (target.direction is not None) + 3 * (target.rotation is not None)
        freedoms -= 3 * (target.mid_m is not None)
        self._redundant = freedoms > 0
        # A target that goes further in a tick than an axis can is not followed at its pace: it has jumped.
        self._jumped = any(abs(pace) > each.step for pace, each in zip(answer_steps, limits, strict=True))
        self._before = self._answer  # the answer that goes along with the line, a tick ago
        self._line: StraightLine | None = None
        self._chase: StraightLine | None = None
        self._task = None if target.tip_m is None else task_of(config, target, extra)
        if self._task is not None:
            self._J = jacobian_of(self._task, self._last, config.limits, middle)
            displaced = displacement_of(self._task, self._last, target.direction is not None)
            goal = displaced(self._answer - self._last)
            drift = goal - displaced(self._answer - self._last - self._paces)
            needed = pseudo_inverse(self._J) @ drift
            self._jumped = any(abs(size) > each.step for size, each in zip(needed, limits, strict=True))
            drift = np.zeros(len(goal)) if self._jumped else drift
            self._line = StraightLine(limits, self._J, displaced, goal, drift)
            part = 0.0 if self._jumped else _part(needed, low, high)
            # Towards a target that goes on, axes at rest go along with it as soon as they can.
            self._before = self._answer - part * self._paces
            self._chase = self._line
            if target.rotation is not None:
                # Few frames between two are in reach, and the roll of an arm may take all of its travel.
                self._chase = None
            elif part < 1.0:
                self._chase = StraightLine(limits, self._J, displaced, goal, part * drift)

    def held(self, clipped: Array, exact_m: float) -> Array | None:
        """The next command of a redundant robot with the tip on its target; None if none was found."""
        if self._line is None or self._line.share < 1.0 or not self._redundant or self._task is None:
            return None
        low, high = self._last + self._low, self._last + self._high
        redundant = Redundant(self._limits, low, high, self._task, self._J, exact_m)
        return redundant.held(self._last, self._answer, self._paces, clipped)

    def towards(self, last_steps: Array, straight: bool) -> tuple[Array | None, bool]:
        """The next command on a straight line to the answer, and whether it is one of the axes.

        None where the line of the axes is blocked.
        """
        limits, low, high = self._limits, self._low, self._high
        if self._chase is not None and not (straight and not self._jumped):
            moving = any(abs(d) > each.change for d, each in zip(last_steps.tolist(), limits, strict=True))
            preferred = self._preferred()
            free = _unbounded(limits, last_steps)
            for halt in (False, True):
                step, share, across = self._chase.step(low, high, preferred, halt)
                at_end = ((step <= low) & (low > free[0])) | ((step >= high) & (high < free[1]))
                if not moving and _stands(limits, step):
                    continue
                if across <= _ACROSS and share > 0.0:
                    settled = self._settled(share)
                    if settled is not None and (moving or not _stands(limits, settled)):
                        return self._last + settled, False
                if not (at_end.any() and across > _ACROSS) and self._can_stop(step):
                    return self._last + step, False
            if moving:
                return self._last + _braked(limits, last_steps, low, high), False
        scale, gap = np.array([each.step for each in limits]), self._answer - self._last
        drift = (0.0 if self._jumped else _part(self._paces, low, high)) * self._paces
        line = StraightLine(limits, np.diag(1.0 / scale), lambda d: d / scale, gap / scale, drift / scale)
        step, _, _ = line.step(low, high, gap)
        if not self._can_stop(step):
            step = _braked(limits, last_steps, low, high)
            if not np.any(last_steps):
                return None, False
        return self._last + step, True

    def _preferred(self) -> Array:
        """The step towards the answer to the next point of the line."""
        if not self._redundant or self._chase is None:
            return np.zeros(len(self._last))
        gap = np.array(self._solved(self._chase.share).actuation[: len(self._last)]) - self._last
        part = 1.0
        for each, size in zip(self._limits, np.abs(gap).tolist(), strict=True):
            if size > _NONE * each.change:
                part = min(part, brake_step(size, each.change) / size)
        step: Array = part * gap
        return step

    def _settled(self, share: float) -> Array | None:
        """The step to the model's answer for a point of the line, if it is allowed and can be stopped."""
        solution = self._solved(share)
        step = np.array(solution.actuation[: len(self._last)]) - self._last
        low, high = self._low, self._high
        slack = _NONE * (high - low)
        if not solution.converged or np.any(step < low - slack) or np.any(step > high + slack):
            return None
        step = np.clip(step, low, high)
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
        ahead = self._last + _ahead(self._limits, step) * step
        return within(self._config, tuple(ahead.tolist()), self._extra)


def within(config: RobotConfig, own: Actuation, extra: Actuation) -> bool:
    """True when the limits of the model, such as a bend radius, allow its axes these values."""
    kept = config.model.inverse(Target(actuation=own), (*own, *extra)).actuation
    axes = zip(kept, own, config.limits, strict=False)
    return max(abs(a - b) / each.step for a, b, each in axes) <= _NONE


def _ahead(limits: Sequence[AxisLimits], step: Array) -> float:
    """How many times its length the axes go if they stop together after a step, n + ... + 1 for n."""
    most: float = max(abs(d) / each.change for d, each in zip(step.tolist(), limits, strict=True))
    return max(1.0, 0.5 * (most + 1.0))


def _stands(limits: Sequence[AxisLimits], steps: Array) -> bool:
    """True for steps that change nothing."""
    return all(abs(d) <= _REST * each.change for d, each in zip(steps.tolist(), limits, strict=True))


def _braked(limits: Sequence[AxisLimits], last_steps: Array, low: Array, high: Array) -> Array:
    """Steps of axes that stop together as fast as they can, an axis near its end by itself."""
    most = max(abs(d) / each.change for d, each in zip(last_steps.tolist(), limits, strict=True))
    step: Array = np.clip(last_steps * (max(0.0, 1.0 - 1.0 / most) if most > 0.0 else 0.0), low, high)
    return step


def _part(paces: Array, low: Array, high: Array) -> float:
    """The greatest part of the axes' paces that they may take in this tick: one at rest has to speed up."""
    part = 1.0
    for pace, least, greatest in zip(paces.tolist(), low.tolist(), high.tolist(), strict=True):
        if pace:
            room = max(greatest, 0.0) if pace > 0.0 else min(least, 0.0)
            part = min(part, room / pace)
    return part


def _unbounded(limits: Sequence[AxisLimits], last_steps: Array) -> tuple[Array, Array]:
    """Least and greatest steps by speed and acceleration alone."""
    step, change = (np.array(side) for side in zip(*((e.step, e.change) for e in limits), strict=True))
    return np.clip(last_steps - change, -step, step), np.clip(last_steps + change, -step, step)
