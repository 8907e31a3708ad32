"""Commands of a tendon robot under the limits of its axes that keep every tension inside its bounds.

The answer is the actuation that the model returned for the target of this tick. Axes that go towards their
answers one by one pull against each other on the way. Here the robot moves in the bends and the tightness of
its sections (`contid.kinematics.tendon.taut`), in which the limits are convex, and after each step it can
still stop on a straight line inside them. ``contid/kernels/limiter/taut.hpp`` has the rule, its derivation
and its source.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from contid.control.tick.limits import AxisLimits
from contid.targets import Actuation
from contid.units import LIMIT_TOLERANCE_M

if TYPE_CHECKING:
    from contid.kinematics.tendon.taut import TautPulls

#: How far tensions stand above the floor on a live stream: the smaller of a share of their range, and of the
#: pull that is a share of a^3 / j^2, the way of an axis that reaches its acceleration.
_LIFT_RANGE: Final = 0.05
_LIFT_WAY: Final = 1.0 / 30.0


def lift_n(taut: TautPulls, acceleration: Sequence[float], jerk: Sequence[float]) -> float:
    """How far the tensions of answers to live targets stand above the floor [N].

    Args:
        taut: the bounds of the tensions.
        acceleration: greatest of every axis [m/s^2].
        jerk: greatest of every axis [m/s^3].
    """
    way_m = min([a * a * a / (j * j) for a, j in zip(acceleration[: len(taut.lower)], jerk, strict=False)])
    return min(_LIFT_WAY * way_m * taut.stiffness_n_per_m, _LIFT_RANGE * taut.range_n)


def lifted(taut: TautPulls, width_n: float, answer: Actuation) -> Actuation:
    """The answer to a live target with tensions above the floor, so that there is room for a limited jerk.

    The least tensions have a corner where another tendon becomes the slackest: the pulls of a smooth path
    change their velocity in one tick, and a motion that rounds the corner would leave the limits. The bends,
    and with them the tip, stay.

    Args:
        taut: the bounds of the tensions.
        width_n: of `lift_n`.
        answer: of the model [m], of the tendons and then of extra axes.
    """
    own = len(taut.lower)
    return (*taut.lifted(answer[:own], width_n), *answer[own:])


def keeps_tensions(taut: TautPulls, command: Actuation, last: Actuation) -> bool:
    """True for pulls inside every limit, or no further outside than the last ones."""
    return taut.excess(command) <= max(taut.excess(last), 0.0) + LIMIT_TOLERANCE_M


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
        taut: the bounds of the tensions.
        limits: of the tendons.
        last: the last command [m].
        last_steps: the last command minus the one before [m].
        answer: the actuation that the model returned [m]; the robot brakes where it is not a number.
        answer_steps: the answer minus that of the tick before [m].
        limited: the command under the limits of the axes alone, and the bits of those that bound it. It is
            kept where the robot can stop after it.
    """
    command: tuple[Actuation, tuple[int, ...]] = taut.kernel.limit(
        limits, last, last_steps, answer, answer_steps, *limited
    )
    return command
