"""Commands of a tendon robot under the limits of its axes that keep every tension inside its bounds.

The answer is the actuation that the model returned for the target of this tick. Axes that go towards their
answers one by one pull against each other on the way. Here the robot moves in the bends and the tightness of
its sections (`contid.kinematics.tendon.taut`), in which the limits are convex. After each step the robot can
still stop on a straight line in these coordinates that ends inside every limit; as the limits are convex, all
of that line is inside. From a step sigma of the coordinates the stop takes n ticks with the steps

    sigma (1 - 1/n), sigma (1 - 2/n), ...,      whose sum is  sigma (n - 1) / 2.

The axis that needs the most ticks to brake determines n. The next step lies between this stop and the motion
to the answer, as near to the motion as the limits of axes and tensions allow; as the stop itself is allowed,
there is always one. The idea is that of the safe sets of invariant braking: F. Blanchini, "Set invariance in
control", Automatica 35(11), 1999.

A step is the change of a value in one tick, the pace of a value is its step where it moves steadily.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from contid.control.tick.limits import REFUSED, TENSION, AxisLimits, allowed_steps, brake_step
from contid.kinematics.array import Array
from contid.targets import Actuation
from contid.units import LIMIT_TOLERANCE_M

if TYPE_CHECKING:
    from contid.kinematics.tendon.taut import TautPulls

#: A pull changes its pace along a straight line of bends and tightness, and this takes a part of the change
#: of step that its axis may make (`AxisLimits.change`). At least this share of it is left for braking:
_MIN_BRAKE_SHARE: Final = 0.2
#: Share of an axis's change of step that a motion to the answer is planned to brake with.
_PLANNED_BRAKE_SHARE: Final = 0.8
#: The pace at an end of a line is the difference quotient over this part of the line.
_DIFFERENCE: Final = 1e-3
#: Rounds in which the number of ticks of a stop is found.
_STOP_ROUNDS: Final = 5
#: Bisections between the stop and the motion to the answer.
_BISECTIONS: Final = 8
#: Pulls that differ by less are equal up to rounding [m].
_STILL_M: Final = 1e-12
#: Rounding, as a part of a change of step or in ticks.
_ROUNDING: Final = 1e-9


def limit_taut(
    taut: TautPulls,
    limits: Sequence[AxisLimits],
    last: Actuation,
    last_steps: Actuation,
    answer: Actuation,
    answer_steps: Sequence[float],
    limited: tuple[Actuation, tuple[int, ...]],
) -> tuple[Actuation, tuple[int, ...]]:
    """Next command of the tendons of a robot [m], and per tendon the bits of the limits that bound it.

    Args:
        taut: conversions between pulls, and bends with tightness.
        limits: of the tendons.
        last: the last command [m].
        last_steps: the last command minus the one before [m].
        answer: the actuation that the model returned [m].
        answer_steps: the answer minus that of the tick before [m].
        limited: the command under the limits of the axes alone, and the bits of those that bound it.
    """
    command, flags = limited
    robot = _TautLimiter(taut, limits, np.array(last), np.array(last_steps))
    candidate = np.array(command)
    if robot.keeps(candidate):
        return command, flags
    tightened = robot.tightened(candidate)
    if tightened is not None:
        return tightened, tuple(flag | TENSION for flag in flags)
    if not all(map(math.isfinite, answer)):
        after = robot.toward(robot.pulls, np.zeros(len(last)))
        flags = tuple(flag | REFUSED for flag in flags)
    else:
        pace = np.array(answer_steps)
        after = robot.toward(np.array(answer), np.where(np.isfinite(pace), pace, 0.0))
    changed = [flag | TENSION if a != b else flag for flag, a, b in zip(flags, after, command, strict=True)]
    return after, tuple(changed)


@dataclass
class _TautLimiter:
    """The limits of the tendons of one robot in one tick.

    Attributes:
        taut: conversions between pulls, and bends with tightness.
        limits: of the axes.
        pulls: the last command [m].
        steps: the last command minus the one before [m].
    """

    taut: TautPulls
    limits: Sequence[AxisLimits]
    pulls: Array
    steps: Array

    def __post_init__(self) -> None:
        self._change = np.array([each.change for each in self.limits])
        self._coordinates = self.taut.split(self.pulls)
        self._coordinate_steps = self._coordinates - self.taut.split(self.pulls - self.steps)
        stop = self._stop(self._coordinates, self._coordinate_steps)
        # A limit that is exceeded already, as after arming a robot bent by hand, may stay exceeded as much.
        excess = np.maximum(self._excess(self.pulls), self._excess(stop.pulls))
        self._allowed = np.maximum(excess, LIMIT_TOLERANCE_M)
        self._may_vary = np.maximum(stop.varies, (1.0 - _MIN_BRAKE_SHARE) * self._change)
        self._may_step = np.maximum(stop.fastest, [each.step for each in self.limits])
        self._braked = self._coordinate_steps * (1.0 - 1.0 / stop.ticks)

    @cached_property
    def _step_bounds(self) -> Array:
        """Least and greatest step of every pull that the limits of its axis allow [m], shape (2, tendons)."""
        steps = zip(self.limits, self.pulls.tolist(), self.steps.tolist(), strict=True)
        return np.array([allowed_steps(*each) for each in steps]).T

    @cached_property
    def _tightness(self) -> Array:
        """Tightness of the last command [N]."""
        return self.taut.tightness(self.pulls)

    def keeps(self, candidate: Array) -> bool:
        """True for a command inside every limit from which the robot can stop inside them."""
        if not (self._excess(candidate) <= self._allowed).all():
            return False
        there = self.taut.split(candidate)
        stop = self._stop(there, there - self._coordinates)
        return bool(
            (stop.varies <= self._may_vary).all()
            and (stop.fastest <= self._may_step).all()
            and (self._excess(stop.pulls) <= self._allowed).all()
        )

    def tightened(self, candidate: Array) -> Actuation | None:
        """The command of the same bends with every tendon taut; None where the limits forbid it."""
        taut = self._taut(candidate)
        return tuple(taut.tolist()) if self._allows(taut) else None

    def toward(self, answer: Array, pace: Array) -> Actuation:
        """The command as near to the motion to the answer as the limits allow."""
        stop, motion = self._braked, self._motion(answer, pace)
        low, high, share = 0.0, 1.0, 1.0
        best = self.taut.join(self._coordinates + stop)
        for _ in range(_BISECTIONS):
            candidate = self.taut.join(self._coordinates + stop + share * (motion - stop))
            if self._allows(candidate):
                low, best = share, candidate
            else:
                high = share
            if low == high:
                break
            share = 0.5 * (low + high)
        best = self._taut(best)
        after = [
            min(max(value, min(each.lower, old)), max(each.upper, old))
            for value, old, each in zip(best.tolist(), self.pulls.tolist(), self.limits, strict=True)
        ]
        return tuple(after)

    def _taut(self, pulls: Array) -> Array:
        """Pulls of the same bends with every tendon taut; the last command where they differ by rounding."""
        taut = self.taut.tightened(pulls, np.minimum(self._tightness, 0.0))
        return self.pulls if float(np.abs(taut - self.pulls).max()) < _STILL_M else taut

    def _motion(self, answer: Array, pace: Array) -> Array:
        """Step of the coordinates towards the answer: the pace of the answer, and a share of the gap to it.

        The share is such that all axes can still brake.
        """
        goal = self.taut.split(answer)
        along = goal - self.taut.split(answer - pace)
        for each, size in zip(
            self.limits, np.abs(answer - self.taut.join(goal - along)).tolist(), strict=True
        ):
            if size > each.step:
                along *= each.step / size
        gap = goal - self._coordinates - along
        share = 1.0
        reach = self._reach(self._coordinates, gap).tolist()
        for size, change in zip(reach, self._change.tolist(), strict=True):
            if size > 0.0:
                share = min(share, brake_step(size, _PLANNED_BRAKE_SHARE * change) / size)
        # A stop from this motion goes on for (n - 1) / 2 steps, which must not lead beyond the answer, where
        # the tightness is least.
        ticks = self._stop(self._coordinates, along + share * gap).ticks
        motion: Array = along + min(share, 2.0 / (ticks + 1.0)) * gap
        return motion

    def _reach(self, at: Array, step: Array) -> Array:
        """Bounds of the steps of the pulls [m] for a step of the coordinates: pulls are convex along it."""
        here, there = self.taut.join(at), self.taut.join(at + step)
        begin = (self.taut.join(at + _DIFFERENCE * step) - here) / _DIFFERENCE
        end = (there - self.taut.join(at + (1.0 - _DIFFERENCE) * step)) / _DIFFERENCE
        reach: Array = np.maximum(np.abs(begin), np.abs(end))
        return reach

    def _allows(self, candidate: Array) -> bool:
        step, (low, high) = candidate - self.pulls, self._step_bounds
        room = _ROUNDING * self._change
        inside = (step >= low - room).all() and (step <= high + room).all()
        return bool(inside) and self.keeps(candidate)

    def _excess(self, pulls: Array) -> Array:
        excess = self.taut.excess(tuple(pulls.tolist()))
        return np.where(np.isfinite(excess), excess, np.inf)

    def _stop(self, at: Array, moved: Array) -> _Stop:
        """The stop from coordinates ``at`` after a step ``moved`` of them.

        Pulls are convex along the line of the stop, so their pace lies between that of the step and that at
        the end. The difference of these paces is not available for braking.
        """
        before = self.taut.join(at) - self.taut.join(at - moved)
        reach, varies = np.abs(before), np.zeros(len(before))
        ticks = 1
        for _ in range(_STOP_ROUNDS):
            braking = np.maximum(self._change - varies, _MIN_BRAKE_SHARE * self._change)
            needed = max(1, math.ceil(float((reach / braking).max()) - _ROUNDING))
            if needed <= ticks:
                break
            ticks = needed
            end = at + 0.5 * (ticks - 1) * moved
            after = ticks * (self.taut.join(end) - self.taut.join(end - moved / ticks))
            reach, varies = np.maximum(np.abs(before), np.abs(after)), np.abs(after - before)
        pulls = self.taut.join(at + 0.5 * (ticks - 1) * moved)
        return _Stop(ticks, pulls, varies, (1.0 - 1.0 / ticks) * reach)


@dataclass(frozen=True)
class _Stop:
    """A stop on a straight line.

    Attributes:
        ticks: number of ticks until rest.
        pulls: at rest [m].
        varies: difference of the paces of each pull at the two ends of the line [m].
        fastest: bound of the step of each pull during the stop [m].
    """

    ticks: int
    pulls: Array
    varies: Array
    fastest: Array
