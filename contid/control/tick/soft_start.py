"""Soft start and soft end of a trajectory that begins or ends at speed.

A circle at constant speed needs a jump of velocity at its first row, and the limits of the axes would take
the tip off its path. Instead the *clock* of the trajectory is eased: over N ticks it gains the pace 0 -> 1 as
``3 u^2 - 2 u^3`` (u = n/N), so after them it is N/2 ticks behind, and the same backwards at the end. Robots
stay on their path at every tick; N is even, so rows written at ticks are still met exactly at ticks. A
trajectory that starts and ends slowly enough for the limits is played as it is written.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.trajectory.timed import Trajectory

# Share of the acceleration and jerk limits that the easing may use; the path itself needs the rest.
_SHARE: Final = 0.5


def played(n: float, length: float, lead: int, tail: int) -> float:
    """Ticks of the trajectory that are played after ``n`` ticks of the run.

    Args:
        n: ticks since the run began.
        length: length of the trajectory in ticks.
        lead: ticks of the soft start.
        tail: ticks of the soft end.
    """
    over = length + 0.5 * (lead + tail)
    left = over - n
    if left <= 0.0:
        return length
    if left < tail:
        return length - _eased(left, tail)
    return _eased(n, lead) if n < lead else n - lead / 2


def fitted(ticks: int, length: float) -> int:
    """The ticks of a soft start or end, shortened to those of the trajectory; an even number."""
    return min(ticks, int(length) // 2 * 2)


def _eased(n: float, ticks: int) -> float:
    """Integral of the pace ``3 u^2 - 2 u^3`` over the first n of ``ticks`` ticks."""
    u = n / ticks
    return ticks * u * u * u * (1.0 - 0.5 * u)


def ease_ticks(configs: Sequence[RobotConfig], trajectory: Trajectory, time_s: float, ahead: bool) -> int:
    """Ticks of the soft start at ``time_s``, or with ``ahead`` false of the soft end there; an even number.

    0 when the acceleration limit allows the speed of the trajectory there within one tick.
    """
    ticks = 0
    if not configs:
        return 0
    period_s = configs[0].period_s
    here = trajectory.targets_at(time_s)
    beside = trajectory.targets_at(time_s + (period_s if ahead else -period_s))
    for config in configs:
        if config.name not in here:
            continue
        start = config.model.inverse(config.frame.target_in_base(here[config.name]), config.rest).actuation
        after = config.model.inverse(config.frame.target_in_base(beside[config.name]), start).actuation
        for axis, limits in enumerate(config.limits):
            step = abs(after[axis] - start[axis])
            if not step > limits.change * _SHARE:
                continue
            speed = step / period_s
            # Peak acceleration of the easing is 1.5 v/T, its peak jerk 6 v/T^2.
            by_acceleration = 1.5 * speed / (_SHARE * config.acceleration[axis])
            by_jerk = math.sqrt(6.0 * speed / (_SHARE * config.jerk[axis]))
            ticks = max(ticks, math.ceil(max(by_acceleration, by_jerk) / period_s))
    return ticks + ticks % 2
