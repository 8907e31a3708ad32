"""Limits of position, velocity and acceleration of every axis: the last step before the transmission.

Everything is compared with the *last command*, never with the measurement: limiting against a lagging
measurement slows a robot down, or throws it, just outside a limit (ros2_control PR 2183).

Work is done in steps, the difference of two consecutive commands. A step is kept under the greatest one
from which the axis can still stop before its limit; ``contid/kernels/limiter/axis.hpp`` has the equation
and the rule.

A target inside every limit is returned bit for bit. A target that is not is chased: the axis runs at the
target's own step plus the greatest step that can still be braked to it, so a jump ends without overshoot.
Jerk is not limited here; approach and stop are jerk-limited before they arrive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from contid.kernels import load
from contid.kinematics.array import Array

# Which limit bound, as bits of one number per axis; the kernel has the same ones.
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


@cache
def kernel() -> Any:
    """The kernel of the limits of a tick, loaded when the first is asked for.

    Raises:
        KernelMissingError: It is not compiled in this installation.
    """
    return load("limiter")


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
    step: float = kernel().brake_step(room, change)
    return step


def stops_within(room: float, step: float, change: float) -> bool:
    """True when what has made a step, and sheds ``change`` per tick, stops within ``room``."""
    stops: bool = kernel().stops_within(room, step, change)
    return stops


def allowed_steps(limits: AxisLimits, last: float, last_step: float) -> tuple[float, float]:
    """Least and greatest step of one axis in the next tick that every limit allows."""
    steps: tuple[float, float] = kernel().allowed_steps(limits, last, last_step)
    return steps


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
        The command and the limits that bound: bits, 0 when the command is the target itself or brakes towards
        it, which no limit cuts.
    """
    command: tuple[float, int] = kernel().limit_axis(limits, last, last_step, target, target_step)
    return command


def limit(
    limits: Sequence[AxisLimits],
    last: Sequence[float],
    last_steps: Sequence[float],
    targets: Sequence[float],
    target_steps: Sequence[float],
) -> tuple[tuple[float, ...], tuple[int, ...]]:
    """Next command of every axis of a robot, and per axis the bits of the limits that bound."""
    limited: tuple[tuple[float, ...], tuple[int, ...]] = kernel().limit(
        limits, last, last_steps, targets, target_steps
    )
    return limited


def followed(
    limits: Sequence[AxisLimits], last: Sequence[float], last_steps: Sequence[float], targets: Array
) -> int:
    """How many of the first targets, shape ``(ticks, axes)``, one a tick, `limit` returns bit for bit."""
    count: int = kernel().followed(limits, last, last_steps, targets)
    return count
