"""Limits that several axes share, such as a bend radius: steps from which the axes can stop inside them.

A shared limit is a function e of the axes, positive beyond it, and convex. A step changes e, and from tick to
tick its step can change by up to ``c = sum |de/dx_i| a_i h^2``, less what the motion along a curved limit
needs. So the greatest step of e that can be braked in the room -e is that of one axis with these two numbers
(`contid.control.tick.limits.brake_step`). Only the motion towards the limit is braked, with every axis that
moves by the same share of what it can.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from contid.control.tick.limits import POSITION, AxisLimits, allowed_steps, brake_step, stops_within
from contid.kinematics.array import Array
from contid.targets import Actuation

#: Linear steps to a curved limit, and bisections of the share of the brakes in each.
_ROUNDS: Final = 8
_BISECTIONS: Final = 40
#: Of what the axes can do in a tick, what is left at least for a curved limit.
_LEAST: Final = 0.1
#: By how much a curved limit may come nearer than its tangent on the way of a stop that needs no second look.
_CURVED: Final = 1.2
#: Greatest slope of a shared limit along one axis.
_STEEPEST: Final = 2.0
#: Within this of a limit the closer look is taken [m], above all rounding.
_NEAR_M: Final = 1e-9
#: Excess that is rounding [m].
_ROUNDING_M: Final = 1e-12


class SharedLimits(Protocol):
    """Interface of the limits that the axes of a model share."""

    def excess(self, actuation: Actuation, /) -> Sequence[float]:
        """By how much every shared limit is exceeded [m], negative inside; convex, no slope above 2."""
        ...

    def gradient(self, actuation: Actuation, number: int, /) -> Sequence[float]:
        """Derivative of one excess by the axes."""
        ...


@dataclass(frozen=True, slots=True)
class _Bound:
    """By how much a step goes too far towards one limit, and the gradient of its excess there."""

    too_far_m: float
    gradient: Sequence[float]


def limit_shared(
    shared: SharedLimits,
    limits: Sequence[AxisLimits],
    last: Actuation,
    last_steps: Sequence[float],
    limited: tuple[Actuation, tuple[int, ...]],
) -> tuple[Actuation, tuple[int, ...]]:
    """Next command of axes that share limits, and per axis the limits that bound.

    Args:
        shared: of the model.
        limits: of its axes.
        last: the last command.
        last_steps: the last command minus the one before.
        limited: command under the limits of every axis by itself, and its flags.
    """
    command, flags = limited
    before = shared.excess(last)
    moves = zip(limits, command, last, last_steps, strict=True)
    brakes = [each.change if new != old or step != 0.0 else 0.0 for each, new, old, step in moves]
    ends = [allowed_steps(each, at, step) for each, at, step in zip(limits, last, last_steps, strict=True)]
    for _ in range(_ROUNDS):
        bound = _exceeded(shared, limits, brakes, last, before, command)
        if bound is None:
            break
        braked, enough = _braked(brakes, ends, last, command, bound)
        if not enough:  # then axes at rest help
            braked, _ = _braked([each.change for each in limits], ends, last, command, bound)
        command = braked
    if command == limited[0]:
        return limited
    pairs = zip(flags, command, limited[0], strict=True)
    return command, tuple([flag | (POSITION if now != was else 0) for flag, now, was in pairs])


def reaches_shared(
    shared: SharedLimits, limits: Sequence[AxisLimits], last: Actuation, commands: Array
) -> int:
    """How many of the first commands, shape ``(ticks, axes)``, `limit_shared` returns without a closer look.

    Between the commands at which limits are computed none comes nearer than its greatest slope allows.
    """
    moves = np.abs(np.diff(commands, axis=0, prepend=[last]))
    on = (moves / [each.change for each in limits]).max(axis=1, initial=0.0)
    reach = _STEEPEST * moves.sum(axis=1) * (1.0 + np.maximum(0.0, 0.5 * (on - 1.0))) + _NEAR_M
    at = 0
    while at < len(commands):
        room = -max(shared.excess(tuple(commands[at].tolist())))
        way = _STEEPEST * np.abs(commands[at:] - commands[at]).sum(axis=1)
        near = np.flatnonzero(room - way <= reach[at:])
        if not len(near):
            return len(commands)
        if near[0] == 0:
            return at
        at += int(near[0])
    return at


def _ahead(moves: Sequence[float], limits: Sequence[AxisLimits]) -> float:
    """How many times their last move axes go on that stop together."""
    return max(0.0, 0.5 * (max([size / each.change for size, each in zip(moves, limits, strict=True)]) - 1.0))


def _exceeded(
    shared: SharedLimits,
    limits: Sequence[AxisLimits],
    brakes: Sequence[float],
    last: Actuation,
    before: Sequence[float],
    command: Actuation,
) -> _Bound | None:
    """The limit that a command goes too far to most, None when the axes can stop before every one."""
    worst: _Bound | None = None
    steps = [new - old for new, old in zip(command, last, strict=True)]
    ahead = _ahead([abs(step) for step in steps], limits)
    after = shared.excess(command)
    for number, (here, there) in enumerate(zip(before, after, strict=True)):
        step, room = there - here, -there
        if step <= _ROUNDING_M or room >= _CURVED * step * ahead + _ROUNDING_M:
            continue
        gradient = shared.gradient(command, number)
        change = sum([abs(slope) * brake for slope, brake in zip(gradient, brakes, strict=True)])
        # One more such step, without brakes: what it adds to e beyond the last one is the curvature.
        onward = tuple([new + d for new, d in zip(command, steps, strict=True)])
        change = max(change - max(0.0, shared.excess(onward)[number] - there - step), _LEAST * change)
        if change <= 0.0 or stops_within(room + _ROUNDING_M, step, change):
            continue
        too_far = step - brake_step(-here, change)
        if worst is None or too_far > worst.too_far_m:
            worst = _Bound(too_far, gradient)
    return worst


def _braked(
    brakes: Sequence[float],
    ends: Sequence[tuple[float, float]],
    last: Actuation,
    command: Actuation,
    bound: _Bound,
) -> tuple[Actuation, bool]:
    """The command with every axis braked by one share, as far as a limit needs, and whether that is enough.

    Args:
        brakes: greatest change of a step, 0 for an axis that does not brake.
        ends: least and greatest step of every axis in this tick.
        last: the last command.
        command: without these limits.
        bound: what has to be kept.
    """

    def at(share: float) -> Actuation:
        """The command where the axes brake by a share of twice their greatest change: from speeding up."""
        moved = []
        for value, slope, brake, start, (low, high) in zip(
            command, bound.gradient, brakes, last, ends, strict=True
        ):
            change = 2.0 * share * brake
            if slope > 0.0:
                value = max(value - change, min(start + low, value))
            elif slope < 0.0:
                value = min(value + change, max(start + high, value))
            moved.append(value)
        return tuple(moved)

    def left(there: Actuation) -> float:
        """By how much it goes too far still [m]."""
        moves = zip(bound.gradient, there, command, strict=True)
        return bound.too_far_m + sum([slope * (new - old) for slope, new, old in moves])

    low, high = 0.0, 1.0
    if left(at(high)) > 0.0:
        return at(high), False
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if left(at(middle)) > 0.0 else (low, middle)
    return at(high), True
