"""Commands of a tendon robot under the limits of its axes that keep every tension inside its bounds.

The answer is the actuation that the model returned for the target of this tick. Axes that go towards their
answers one by one pull against each other on the way. Here the robot moves in the bends and the tightness of
its sections (`contid.kinematics.tendon.taut`), in which the limits are convex, and after each step it can
still stop on a straight line inside them. ``contid/kernels/limiter/taut.hpp`` has the rule, its derivation
and its source.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from contid.control.tick.limits import AxisLimits
from contid.targets import Actuation

if TYPE_CHECKING:
    from contid.kinematics.tendon.taut import TautPulls


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
