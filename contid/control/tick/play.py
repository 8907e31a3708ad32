"""Play of the drives, such as tendons in their sheaths: commands lead it, so that what was asked for arrives.

An axis with the half width r of play delivers ``command + offset -+ r`` while it moves up or down. The offset
that is added to commands goes to +r or -r with the last direction of motion and stays at rest, the inverse of
the play operator (`contid.kinematics.tendon.friction`). A turn of direction takes up the play at most at the
velocity limit of the axis, on top of its motion. Offsets are part of the robot's state, as replay needs.
"""

from __future__ import annotations

from collections.abc import Sequence

from contid.control.tick.limits import AxisLimits
from contid.targets import Actuation


def taken_up(
    half_width: Sequence[float],
    offsets: Sequence[float],
    increments: Sequence[float],
    limits: Sequence[AxisLimits],
) -> Actuation:
    """Offsets after a tick [m or Pa].

    Args:
        half_width: r of every axis; 0 is none.
        offsets: of the tick before; empty before the first.
        increments: of the commands in this tick.
        limits: of the axes; their step bounds the change.
    """
    before = offsets or (0.0,) * len(half_width)
    after = []
    for r, offset, increment, axis in zip(half_width, before, increments, limits, strict=True):
        goal = r if increment > 0.0 else -r if increment < 0.0 else offset
        after.append(min(max(goal, offset - axis.step), offset + axis.step))
    return tuple(after)


def led(command: Actuation, offsets: Actuation) -> Actuation:
    """What the transmission gets for a command; the command itself without play."""
    return tuple([a + b for a, b in zip(command, offsets, strict=True)]) if offsets else command
