"""Commands of a tendon robot under the limits of its axes that keep every tension inside its bounds.

Axes that go towards their answers one by one pull against each other on the way. Here the robot moves in the
bends and the tightness of its sections (`contid.kinematics.tendon.taut`), in which the limits are convex, and
each step leaves a stop on a straight line that ends inside every limit; so all of that line is inside. From a
step sigma of these coordinates the stop takes n ticks,

    sigma (1 - 1/n), sigma (1 - 2/n), ...,      together  sigma (n - 1) / 2,

n from the axis that needs most. The next step lies between this stop and the motion to the answer, as near
to the motion as the limits of axes and tensions allow; so there is always one. The idea is that of the safe
sets of invariant braking: F. Blanchini, "Set invariance in control", Automatica 35(11), 1999.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from contid.control.tick.limits import REFUSED, TENSION, AxisLimits, allowed_steps, brake_step
from contid.kinematics.array import Array
from contid.targets import Actuation
from contid.units import LIMIT_TOLERANCE_M

#: Shares of an axis's change of step: that brakes where the pace of the pulls varies most, and usually.
_LEAST: Final = 0.2
_USUAL: Final = 0.8
#: Part of a line whose pace stands for that at its end.
_SHORT: Final = 1e-3
_TRIES: Final = 5
#: Bisections between the stop and the motion to the answer.
_ROUNDS: Final = 8
#: A step below this is none [m].
_STILL_M: Final = 1e-12
_ROUNDING: Final = 1e-9


class Taut(Protocol):
    """Interface of `contid.kinematics.tendon.taut.TautPulls`."""

    def excess(self, actuation: Actuation, /) -> Array:
        """By how much pulls [m] exceed every limit of travel, tension and bends; convex."""
        ...

    def tightness(self, pulls: Array) -> Array:
        """Tightness of every section [N]."""
        ...

    def tightened(self, pulls: Array, tightness: Array) -> Array:
        """Pulls [m] of the same bends with at least this tightness [N]."""
        ...

    def split(self, pulls: Array) -> Array:
        """Coordinates of pulls [m]: bends, tightness and what is left."""
        ...

    def join(self, coordinates: Array) -> Array:
        """Pulls [m] of coordinates."""
        ...


def limit_taut(
    taut: Taut,
    limits: Sequence[AxisLimits],
    last: Actuation,
    last_steps: Actuation,
    answer: Actuation,
    answer_steps: Sequence[float],
    limited: tuple[Actuation, tuple[int, ...]],
) -> tuple[Actuation, tuple[int, ...]]:
    """Next command of the tendons of a robot, and per tendon the limits that bound.

    Args:
        taut: of the robot.
        limits: of its tendons.
        last: the last command.
        last_steps: the last command minus the one before.
        answer: of the model.
        answer_steps: how far it moved in this tick.
        limited: the command under the limits of the axes alone, and what bound.
    """
    command, flags = limited
    robot = _Robot(taut, limits, np.array(last), np.array(last_steps))
    candidate = np.array(command)
    if robot.keeps(candidate):
        return command, flags
    tightened = robot.tightened(candidate)
    if tightened is not None:
        return tightened, tuple(flag | TENSION for flag in flags)
    if not all(map(math.isfinite, answer)):
        after = robot.toward(robot.at, np.zeros(len(last)))
        flags = tuple(flag | REFUSED for flag in flags)
    else:
        pace = np.array(answer_steps)
        after = robot.toward(np.array(answer), np.where(np.isfinite(pace), pace, 0.0))
    changed = [flag | TENSION if a != b else flag for flag, a, b in zip(flags, after, command, strict=True)]
    return after, tuple(changed)


@dataclass
class _Robot:
    """The robot in one tick.

    Attributes:
        taut: see `Taut`.
        limits: of the axes.
        at, steps: the last command, and the last step [m].
    """

    taut: Taut
    limits: Sequence[AxisLimits]
    at: Array
    steps: Array

    def __post_init__(self) -> None:
        bounds = [
            allowed_steps(*each)
            for each in zip(self.limits, self.at.tolist(), self.steps.tolist(), strict=True)
        ]
        self._low, self._high = np.array(bounds).T
        self._change = np.array([each.change for each in self.limits])
        self._here = self.taut.split(self.at)
        self._moved = self._here - self.taut.split(self.at - self.steps)
        self._tightness = self.taut.tightness(self.at)
        stop = self._stop(self._here, self._moved)
        # What is exceeded already, as after arming a robot bent by hand, may stay so but not grow.
        excess = np.maximum(self._excess(self.at), self._excess(stop.pulls))
        self._allowed = np.maximum(excess, LIMIT_TOLERANCE_M)
        self._may_vary = np.maximum(stop.varies, (1.0 - _LEAST) * self._change)
        self._may_step = np.maximum(stop.fastest, [each.step for each in self.limits])
        self._braked = self._moved * (1.0 - 1.0 / stop.ticks)

    def keeps(self, candidate: Array) -> bool:
        """True for a command inside every limit from which the robot can stop inside them."""
        if not np.all(self._excess(candidate) <= self._allowed):
            return False
        there = self.taut.split(candidate)
        stop = self._stop(there, there - self._here)
        return bool(
            np.all(stop.varies <= self._may_vary)
            and np.all(stop.fastest <= self._may_step)
            and np.all(self._excess(stop.pulls) <= self._allowed)
        )

    def tightened(self, candidate: Array) -> Actuation | None:
        """The command of the same bends with every tendon taut; None where the limits forbid it."""
        taut = self._taut(candidate)
        return tuple(taut.tolist()) if self._allows(taut) else None

    def toward(self, answer: Array, pace: Array) -> Actuation:
        """The command as near to the motion to the answer as the limits allow."""
        stop, motion = self._braked, self._motion(answer, pace)
        low, high, share = 0.0, 1.0, 1.0
        best = self.taut.join(self._here + stop)
        for _ in range(_ROUNDS):
            candidate = self.taut.join(self._here + stop + share * (motion - stop))
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
            for value, old, each in zip(best.tolist(), self.at.tolist(), self.limits, strict=True)
        ]
        return tuple(after)

    def _taut(self, pulls: Array) -> Array:
        """Pulls of the same bends with every tendon taut; the last command where they differ by rounding."""
        taut = self.taut.tightened(pulls, np.minimum(self._tightness, 0.0))
        return self.at if float(np.abs(taut - self.at).max()) < _STILL_M else taut

    def _motion(self, answer: Array, pace: Array) -> Array:
        """Step of the coordinates to the answer: its own pace, and what all axes can brake from."""
        goal = self.taut.split(answer)
        along = goal - self.taut.split(answer - pace)
        for each, size in zip(
            self.limits, np.abs(answer - self.taut.join(goal - along)).tolist(), strict=True
        ):
            if size > each.step:
                along *= each.step / size
        gap = goal - self._here - along
        share = 1.0
        for size, change in zip(self._reach(self._here, gap).tolist(), self._change.tolist(), strict=True):
            if size > 0.0:
                share = min(share, brake_step(size, _USUAL * change) / size)
        # The stop from it goes on for (n - 1) / 2 steps, which must not lead beyond the answer: tightness is
        # least there.
        ticks = self._stop(self._here, along + share * gap).ticks
        motion: Array = along + min(share, 2.0 / (ticks + 1.0)) * gap
        return motion

    def _reach(self, at: Array, step: Array) -> Array:
        """Bounds of the pulls' steps for a step of the coordinates [m]; they are convex along it."""
        here, there = self.taut.join(at), self.taut.join(at + step)
        begin = (self.taut.join(at + _SHORT * step) - here) / _SHORT
        end = (there - self.taut.join(at + (1.0 - _SHORT) * step)) / _SHORT
        reach: Array = np.maximum(np.abs(begin), np.abs(end))
        return reach

    def _allows(self, candidate: Array) -> bool:
        step = candidate - self.at
        room = _ROUNDING * self._change
        inside = np.all(step >= self._low - room) and np.all(step <= self._high + room)
        return bool(inside) and self.keeps(candidate)

    def _excess(self, pulls: Array) -> Array:
        excess = self.taut.excess(tuple(pulls.tolist()))
        return np.where(np.isfinite(excess), excess, np.inf)

    def _stop(self, at: Array, moved: Array) -> _Stop:
        """The stop from a place after a step of the coordinates.

        Pulls are convex along the line of the stop, so their pace varies from that of the step to that at the
        end. What it varies by is kept out of the change of step that brakes.
        """
        before = self.taut.join(at) - self.taut.join(at - moved)
        reach, varies = np.abs(before), np.zeros(len(before))
        ticks = 1
        for _ in range(_TRIES):
            left = np.maximum(self._change - varies, _LEAST * self._change)
            needed = max(1, math.ceil(float(np.max(reach / left)) - _ROUNDING))
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
        ticks: until rest.
        pulls: at rest [m].
        varies: how much the pace of each pull changes on a steady motion along the line [m].
        fastest: bound of the step of each pull in the stop [m].
    """

    ticks: int
    pulls: Array
    varies: Array
    fastest: Array
