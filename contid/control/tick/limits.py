"""Limits of position, velocity and acceleration of every axis: the last step before the transmission.

Everything is compared with the *last command*, never with the measurement: limiting against a lagging
measurement slows a robot down, or throws it, just outside a limit (ros2_control PR 2183).

Work is done in steps, the difference of two consecutive commands: with the period h a velocity v is the step
``v h`` and an acceleration a is the change of step ``a h^2``. From a step s an axis that sheds ``c = a h^2``
per tick still travels ``s - c, s - 2c, ...``; so the greatest step that stops within the room d is

    s = d / (n + 1) + n c / 2      with the greatest n for which  c n (n + 1) / 2 <= d,

the discrete form of ``v <= sqrt(2 a d)``. An axis kept under it can always stop before its limit.

A target inside every limit is returned bit for bit. A target that is not is chased: the axis runs at the
target's own step plus the greatest step that can still be braked to it, so a jump ends without overshoot.
Jerk is not limited here; approach and stop are jerk-limited before they arrive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

# Which limit bound, as bits of one number per axis.
POSITION: Final = 1
VELOCITY: Final = 2
ACCELERATION: Final = 4
REFUSED: Final = 8  # the target was not a number; the axis brakes
TENSION: Final = 16  # the tendons of the robot move together, so that tensions stay inside their bounds

FLAG_NAMES: Final[dict[int, str]] = {
    POSITION: "position",
    VELOCITY: "velocity",
    ACCELERATION: "acceleration",
    REFUSED: "refused",
    TENSION: "tension",
}

# A trajectory that runs exactly at a limit differs from it by rounding; this much is not "beyond".
_SLACK: Final = 1.0 + 1e-9


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Limits of one axis, in the units of its commands [m or Pa].

    Attributes:
        lower: least position.
        upper: greatest position.
        step: greatest difference of two consecutive commands, ``velocity * period``.
        change: greatest difference of two consecutive steps, ``acceleration * period^2``.
    """

    lower: float
    upper: float
    step: float
    change: float


def axis_limits(
    lower: Sequence[float],
    upper: Sequence[float],
    velocity: Sequence[float],
    acceleration: Sequence[float],
    period_s: float,
) -> tuple[AxisLimits, ...]:
    """Limits of every axis from ranges [m, Pa or rad], rates and the period [s]."""
    return tuple(
        AxisLimits(low, high, v * period_s, a * period_s * period_s)
        for low, high, v, a in zip(lower, upper, velocity, acceleration, strict=True)
    )


def brake_step(room: float, change: float) -> float:
    """Greatest step that, shedding ``change`` per tick, stops within ``room`` (the step itself included)."""
    if room <= 0.0:
        return 0.0
    n = int((math.sqrt(1.0 + 8.0 * room / change) - 1.0) / 2.0)
    return room / (n + 1) + 0.5 * n * change


def limit_axis(
    limits: AxisLimits, last: float, last_step: float, target: float, target_step: float
) -> tuple[float, int]:
    """Next command of one axis.

    Args:
        limits: of this axis.
        last: the last command.
        last_step: the last command minus the one before.
        target: of the axis.
        target_step: how far the target moves per tick.

    Returns:
        The command and the limits that bound (bits; 0 when the command is the target itself).
    """
    if not limits.lower <= last <= limits.upper:
        # Outside, the axis goes no further out, and inwards only with its target: it never moves by itself.
        lower, upper = min(limits.lower, last), max(limits.upper, last)
        limits = AxisLimits(lower, upper, limits.step, limits.change)
    step = target - last
    slack = limits.change * _SLACK
    if (
        limits.lower <= target <= limits.upper
        and abs(step) <= limits.step * _SLACK
        and abs(step - last_step) <= slack
        and abs(step - target_step) <= slack  # 0 once on target; arriving faster than this would overshoot
        and (abs(step) <= slack or _can_stop(limits, step, target))
    ):
        return target, 0
    return _limited(limits, last, last_step, target, target_step)


def allowed_steps(limits: AxisLimits, last: float, last_step: float) -> tuple[float, float]:
    """Least and greatest step of one axis in the next tick that every limit allows."""
    lower, upper = min(limits.lower, last), max(limits.upper, last)
    inwards, outwards = -brake_step(last - lower, limits.change), brake_step(upper - last, limits.change)
    ends = []
    for end in (last_step - limits.change, last_step + limits.change):
        step = min(max(end, -limits.step), limits.step)
        ends.append(min(max(step, inwards), outwards))
    return ends[0], ends[1]


def _can_stop(limits: AxisLimits, step: float, position: float) -> bool:
    """True when an axis that arrives at ``position`` with ``step`` can brake before its limit."""
    room = limits.upper - position if step > 0.0 else position - limits.lower
    return stops_within(room, abs(step), limits.change)


def stops_within(room: float, step: float, change: float) -> bool:
    """True when what has made a step, and sheds ``change`` per tick, stops within ``room``."""
    n = int(step / change)
    return n * step - 0.5 * change * n * (n + 1) <= room + change * 1e-9


def _limited(
    limits: AxisLimits, last: float, last_step: float, target: float, target_step: float
) -> tuple[float, int]:
    """The command when the target itself cannot be commanded."""
    flags = 0
    if math.isfinite(target):
        inside = min(max(target, limits.lower), limits.upper)
        if inside != target:
            flags, target_step = POSITION, 0.0
        if not math.isfinite(target_step):
            target_step = 0.0
        pace = min(max(target_step, -limits.step), limits.step)
        gap = inside - last - pace
        chase = brake_step(abs(gap), limits.change)
        want = inside - last if chase >= abs(gap) else pace + math.copysign(chase, gap)
    else:
        flags, inside, want = REFUSED, last, 0.0
    step = min(max(want, last_step - limits.change), last_step + limits.change)
    if step != want:
        flags |= ACCELERATION
    if abs(step) > limits.step:
        step = math.copysign(limits.step, step)
        flags |= VELOCITY
    # At a limit there is no room outwards: the position wins over the acceleration.
    lower, upper = limits.lower, limits.upper
    braked = min(max(step, -brake_step(last - lower, limits.change)), brake_step(upper - last, limits.change))
    if braked != step:
        flags |= POSITION
    if braked == inside - last:
        return inside, flags
    return min(max(last + braked, lower), upper), flags


def limit(
    limits: Sequence[AxisLimits],
    last: Sequence[float],
    last_steps: Sequence[float],
    targets: Sequence[float],
    target_steps: Sequence[float],
) -> tuple[tuple[float, ...], tuple[int, ...]]:
    """Next command of every axis of a robot, and per axis the bits of the limits that bound."""
    commands, flags = [], []
    for axis, position, step, target, pace in zip(
        limits, last, last_steps, targets, target_steps, strict=True
    ):
        command, bound = limit_axis(axis, position, step, target, pace)
        commands.append(command)
        flags.append(bound)
    return tuple(commands), tuple(flags)
