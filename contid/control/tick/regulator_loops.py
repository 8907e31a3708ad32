"""Hysteresis of regulators, taken out: commands lead chambers that follow only the edges of a loop.

A chamber holds while its regulator moves inside a loop of half width r (a play operator)::

    f = clip(f before, u - r, u + r)        u = c + x

c is the pressure that the chamber is to have, u the command to the regulator. The exact lead jumps by 2 r
where c turns, also at its noise, so x runs towards it instead: ``x' = gain (c - f)``, inside -r to r. At rest
the chamber has c. A gap below a tenth of r moves nothing: commands of a resting arm are constant.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from contid.control.tick.limits import AxisLimits
from contid.control.tick.play import Lead, held, led
from contid.targets import Actuation

GAIN_PER_S: Final = 8.0
#: Part of the half width that counts as no gap.
_MET: Final = 0.1


def next_loop_lead(
    half_width: Sequence[float],
    before: Lead,
    command: Actuation,
    limits: Sequence[AxisLimits],
    period_s: float,
) -> Lead:
    """The lead after a tick.

    Args:
        half_width: r of every axis [Pa]; 0 is no loop.
        before: of the tick before.
        command: of this tick (c above) [Pa].
        limits: of the axes; a command with its lead stays within.
        period_s: of the tick.
    """
    share = -math.expm1(-GAIN_PER_S * period_s)
    added = []
    leads, chambers = before.play or (0.0,) * len(command), before.delivered or command
    for r, x, f, c, axis in zip(half_width, leads, chambers, command, limits, strict=True):
        gap = c - f
        moved = x if abs(gap) <= _MET * r else min(max(x + share * gap, -r), r)
        added.append(min(max(moved, axis.lower - c), axis.upper - c) if r else 0.0)
    ahead = led(command, tuple(added))
    return Lead(tuple(added), tuple(added), delivered=held(half_width, chambers, ahead))
