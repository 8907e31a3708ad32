"""States of the axes from which they can stop inside every limit: of velocity, of position, and shared.

Used by `contid.control.tick.jerk_guard`. Limits that axes share are convex functions of the axes; those of a
tendon robot are its tensions, travels and bends, which are convex in its pulls as well.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.targets import Actuation
from contid.trajectory.pursuit import AxisRates, Lines, MovingAxes, stopping
from contid.units import LIMIT_TOLERANCE_M

#: A bound counts as kept up to this share of it: rounding.
SLACK: Final = 1.0 + 1e-6
#: Greatest slope of a shared limit along one axis, and excess of one that is rounding [m]
#: (`contid.control.tick.shared_limits`); of tensions it is `contid.units.LIMIT_TOLERANCE_M`.
_STEEPEST: Final = 2.0
_ROUNDING_M: Final = 1e-12
#: Share of the velocity below which an axis counts as moving with it, for how far a stop can lead.
_SLOW: Final = 0.05
#: States of a stop that are compared with limits that axes share, and where it comes close to their bounds:
#: an axis that still accelerates leads beyond them early in its stop, and tensions have corners.
_LOOKED_AT: Final = 4
_LOOKED_AT_CLOSELY: Final = 32


def stops_inside(config: RobotConfig, state: MovingAxes, last: Actuation) -> bool:
    """True when axes that share limits can stop together inside them.

    Args:
        config: of the robot.
        state: of the axes.
        last: command before; where it exceeds a limit, the axes may go on to do so as much.
    """
    own = len(state.position) - config.extra_axes
    if config.taut is None and config.shared is None:
        return True
    most = excess(config, state.position)
    if config.taut is None:
        rates = zip(state.velocity[:own], config.velocity, config.acceleration, config.jerk, strict=False)
        reach = [max(abs(v), _SLOW * top) * (abs(v) / a + 2.0 * a / j) for v, top, a, j in rates]
        if -most > _STEEPEST * sum(reach):
            return True
    rounding_m = _ROUNDING_M if config.taut is None else LIMIT_TOLERANCE_M
    allowed = max(excess(config, last), 0.0) + rounding_m
    if most > allowed:
        return False
    if config.taut is None and config.motion_rules < 2:
        return _stop_keeps(config, state, last, allowed, _LOOKED_AT)
    return _stop_keeps(config, state, last, allowed, _LOOKED_AT, clearly=True) or _stop_keeps(
        config, state, last, allowed, _LOOKED_AT_CLOSELY
    )


def _stop_keeps(
    config: RobotConfig,
    state: MovingAxes,
    last: Actuation,
    allowed_m: float,
    looked_at: int,
    *,
    clearly: bool = False,
) -> bool:
    """True when no state of a stop exceeds the limits that axes share by more than this.

    ``clearly``: nor would one that is as far beyond a state as the next one is from it.
    """
    rates = AxisRates(config.velocity, config.acceleration, config.jerk)
    ways = stopping(state, rates, looked_at, Lines.of(config.motion_rules))
    if not all(_within(config, way.position, last) for way in ways):
        return False
    if not clearly:
        return all(excess(config, way.position) <= allowed_m for way in ways)
    found = [excess(config, position) for position in (state.position, *(way.position for way in ways))]
    return all(max(a, b) + abs(b - a) <= allowed_m for a, b in pairwise(found))


def excess(config: RobotConfig, axes: Actuation) -> float:
    """By how much the limit that axes share, and exceed most, is exceeded [m]; negative inside."""
    own = axes[: len(axes) - config.extra_axes]
    if config.taut is not None:
        return config.taut.excess(own)
    return max(config.shared.excess(own)) if config.shared is not None else -math.inf


def _within(config: RobotConfig, position: Actuation, last: Actuation) -> bool:
    """True when every axis is inside its limits of position, or no further outside than it was."""
    return all(
        min(each.lower, was) - _ROUNDING_M <= at <= max(each.upper, was) + _ROUNDING_M
        for each, at, was in zip(config.limits, position, last, strict=True)
    )


def viable(config: RobotConfig, index: int, at: float, speed: float, bend: float) -> bool:
    """True when an axis can go on from a state within its velocity, and stop within its limits of position.

    Args:
        config: of the robot.
        index: of the axis.
        at: its position.
        speed: its velocity times the period.
        bend: its acceleration times the period squared.
    """
    limits, h = config.limits[index], config.period_s
    jolt = config.jerk[index] * h * h * h
    if abs(speed + 0.5 * bend * abs(bend) / jolt) > limits.step * SLACK:
        return False
    if speed < 0.0:
        room, speed, bend = at - limits.lower, -speed, -bend
    else:
        room = limits.upper - at
    # More than any stop needs. By rules 1 it left out that an axis which accelerates becomes faster first.
    top, more = speed, 1.0
    if config.motion_rules > 1 and bend > 0.0:
        top, more = speed + 0.5 * bend * bend / jolt, 1.5
    return room > top * (top / limits.change + more * limits.change / jolt + 1.0) or (
        _stop_length(speed, bend, limits.change, jolt) <= max(room, 0.0) + limits.change * 1e-6
    )


def _stop_length(speed: float, bend: float, change: float, jolt: float) -> float:
    """How far an axis goes on that stops as soon as it can, in the units of its steps."""
    if bend >= 0.0:  # its speed grows until its acceleration is zero
        top = speed + 0.5 * bend * bend / jolt
        return speed * bend / jolt + bend**3 / (3.0 * jolt * jolt) + _from_cruise(top, change, jolt)
    # It is on the way of a stop that began earlier, without acceleration.
    ticks = -bend / jolt
    top = speed + 0.5 * bend * bend / jolt
    if ticks > min(change / jolt, math.sqrt(top / jolt)):
        return speed * ticks
    return max(0.0, _from_cruise(top, change, jolt) - (top * ticks - jolt * ticks**3 / 6.0))


def _from_cruise(speed: float, change: float, jolt: float) -> float:
    """Way of a stop from a speed without acceleration."""
    ticks = (
        speed / change + change / jolt if speed * jolt >= change * change else 2.0 * math.sqrt(speed / jolt)
    )
    return 0.5 * speed * ticks


def stays_viable(config: RobotConfig, after: MovingAxes, last: Actuation) -> bool:
    """True for a state of the axes from which they can stop inside every limit."""
    h = config.period_s
    axes = enumerate(zip(*after, strict=True))
    each = all(viable(config, index, at, v * h, a * h * h) for index, (at, v, a) in axes)
    return each and stops_inside(config, after, last)
