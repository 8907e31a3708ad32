"""A tip that closes on an object: its state, and its motion on a straight line of the axes.

The line goes from the command at the begin to the target; a share s of it is where the axes have to be. The
share moves jerk-limited, and stays between start and target.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.control.tick.squeezing import Squeeze, actuation_at

#: Of the way, for the motion of the tip; greatest speed at the end of the way over what is left [1/s].
STEP: Final = 1e-4
_ARRIVING: Final = 20.0


def tip_travel_m(config: RobotConfig, squeeze: Squeeze) -> float:
    """Travel of the tip per share of the way [m]."""
    ends = []
    for share in (squeeze.share - STEP, squeeze.share + STEP):
        ends.append(config.model.forward(actuation_at(squeeze, share)).tip_m)
    return math.dist(*ends) / (2.0 * STEP)


def device_turns(config: RobotConfig, squeeze: Squeeze) -> list[float]:
    """Rotation of every device per share of the way [rad]; transmissions of rotations are linear."""
    ends = tuple([a + b for a, b in zip(squeeze.start, squeeze.way, strict=True)])
    to_device = config.transmission.to_device
    return [b - a for a, b in zip(to_device(squeeze.start), to_device(ends), strict=True)]


def greatest_rate(config: RobotConfig, squeeze: Squeeze) -> float:
    """Greatest rate of the share with every axis within its velocity [1/s]."""
    return min(limit / abs(part) for limit, part in zip(config.velocity, squeeze.way, strict=True) if part)


def moved(config: RobotConfig, squeeze: Squeeze, goal: float) -> Squeeze:
    """The next share of the way towards a rate [1/s], with the acceleration and jerk of every axis.

    Near the greatest rate it asks for more: 4 % of speed where the acceleration ends, and up to 3.7 times the
    acceleration on arrival. The limits of the tick bound the commands (`contid.control.tick.limits`).
    """
    period_s = config.period_s
    acceleration, jerk = (
        min(limit / abs(part) for limit, part in zip(limits, squeeze.way, strict=True) if part)
        for limits in (config.acceleration, config.jerk)
    )
    fastest = greatest_rate(config, squeeze)
    goal = min(goal, fastest, (1.0 - squeeze.share) * _ARRIVING)
    goal = max(goal, -fastest, -squeeze.share * _ARRIVING)
    gap = goal - squeeze.rate
    change = math.copysign(min(acceleration, math.sqrt(2.0 * jerk * abs(gap))), gap)
    change = min(max(change, squeeze.change - jerk * period_s), squeeze.change + jerk * period_s)
    if abs(gap) <= abs(change) * period_s and abs(squeeze.change) <= jerk * period_s:
        rate, change = goal, gap / period_s
    else:
        rate = squeeze.rate + change * period_s
    share = min(max(squeeze.share + rate * period_s, 0.0), 1.0)
    return replace(squeeze, share=share, rate=rate, change=change)
