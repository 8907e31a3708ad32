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
from contid.trajectory.planned_motion import AxisRates, Lines, MovingAxes
from contid.trajectory.pursuit import stopping
from contid.units import LIMIT_TOLERANCE_M

#: A bound counts as kept up to this share of it: rounding.
SLACK: Final = 1.0 + 1e-6
#: Greatest slope of a shared limit along one axis, which `contid.control.tick.shared_limits.SharedLimits`
#: promises, and excess of one that is rounding [m]; of tensions it is `contid.units.LIMIT_TOLERANCE_M`.
_STEEPEST: Final = 2.0
_ROUNDING_M: Final = 1e-12
#: By motion rules before 3, an axis had at least this share of its greatest velocity in the estimate of the
#: way of its stop.
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
        # Together they take as long as the slowest, each at its top speed at most; rules before 3 had an
        # estimate, less than the way of an axis that is slow and accelerates.
        if config.motion_rules > 2:
            each = [(v, a, j, abs(b)) for (v, _, a, j), b in zip(rates, state.acceleration, strict=False)]
            tops = [abs(v) + 0.5 * b * b / j for v, _, j, b in each]
            stop_s = max(b / j + top / a + a / j for top, (_, a, j, b) in zip(tops, each, strict=True))
            reach = [top * stop_s for top in tops]
        else:
            reach = [max(abs(v), _SLOW * top) * (abs(v) / a + 2.0 * a / j) for v, top, a, j in rates]
        if -most > _STEEPEST * sum(reach):
            return True
    rounding_m = _ROUNDING_M if config.taut is None else LIMIT_TOLERANCE_M
    allowed = max(excess(config, last), 0.0) + rounding_m
    if most > allowed:
        return False
    if config.taut is None and config.motion_rules < 2:
        return _stop_keeps(config, state, last, allowed, _LOOKED_AT)
    return _stop_keeps(config, state, last, allowed, _LOOKED_AT, with_margin=True) or _stop_keeps(
        config, state, last, allowed, _LOOKED_AT_CLOSELY
    )


def _stop_keeps(
    config: RobotConfig,
    state: MovingAxes,
    last: Actuation,
    allowed_m: float,
    looked_at: int,
    *,
    with_margin: bool = False,
) -> bool:
    """True when no state of a stop exceeds the limits that axes share by more than ``allowed_m``.

    ``with_margin``: the larger excess of two neighbouring states, plus their difference, does not either.
    This stands in for the states between the two, which are not computed.
    """
    rates = AxisRates(config.velocity, config.acceleration, config.jerk)
    ways = stopping(state, rates, looked_at, Lines.of(config.motion_rules))
    if not all(_within(config, way.position, last) for way in ways):
        return False
    if not with_margin:
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


def viable(config: RobotConfig, index: int, at: float, speed: float, acceleration: float) -> bool:
    """True when an axis can go on from a state within its velocity, and stop within its limits of position.

    Times are counted in ticks, as in `contid.control.tick.limits.AxisLimits`.

    Args:
        config: of the robot.
        index: of the axis.
        at: its position [m, Pa or rad].
        speed: its velocity times the period [that per tick].
        acceleration: its acceleration times the period squared [that per tick^2].
    """
    limits, h = config.limits[index], config.period_s
    jolt = config.jerk[index] * h * h * h
    # The speed when the acceleration has been brought to zero at the full jerk.
    if abs(speed + 0.5 * acceleration * abs(acceleration) / jolt) > limits.step * SLACK:
        return False
    if speed < 0.0:
        room, speed, acceleration = at - limits.lower, -speed, -acceleration
    else:
        room = limits.upper - at
    if config.motion_rules > 2:  # a deceleration above its greatest is so by rounding
        acceleration = max(acceleration, -limits.change)
    # More than any stop needs: one from ``top`` without acceleration takes top / change + change / jolt ticks
    # at most, with half of ``top`` as its mean speed. An axis that accelerates gets to ``top`` in up to
    # change / jolt ticks before it: with half of those of the stop, 1.5. One tick is added. Motion rules
    # before 2 left this acceleration out (`contid.control.tick.config.MOTION_RULES`).
    top, jerk_phases = speed, 1.0
    if config.motion_rules > 1 and acceleration > 0.0:
        top, jerk_phases = speed + 0.5 * acceleration * acceleration / jolt, 1.5
    return room > top * (top / limits.change + jerk_phases * limits.change / jolt + 1.0) or (
        _stop_length(speed, acceleration, limits.change, jolt) <= max(room, 0.0) + limits.change * 1e-6
    )


def _stop_length(speed: float, acceleration: float, change: float, jolt: float) -> float:
    """How far an axis goes on that stops as soon as it can [m, Pa or rad].

    Args:
        speed: towards the limit, not negative, per tick.
        acceleration: positive towards the limit, per tick^2.
        change: greatest acceleration, per tick^2.
        jolt: greatest change of the acceleration, per tick^3.
    """
    if acceleration >= 0.0:  # its speed grows to ``top`` until its acceleration is zero
        top = speed + 0.5 * acceleration * acceleration / jolt
        until_top = speed * acceleration / jolt + acceleration**3 / (3.0 * jolt * jolt)
        return until_top + _from_cruise(top, change, jolt)
    # It decelerates as in a stop that began at the speed ``top`` without acceleration, ``ticks`` ago.
    ticks = -acceleration / jolt
    top = speed + 0.5 * acceleration * acceleration / jolt
    # The deceleration of that stop, jolt ticks, grows to the smaller of ``change`` and sqrt(top jolt). One
    # above sqrt(top jolt) stops the axis before it can be brought to zero, so within ``ticks`` and never
    # faster than ``speed``. By motion rules before 3, one above ``change`` by rounding got the same way, too
    # short for an axis that is fast.
    if ticks > min(change / jolt, math.sqrt(top / jolt)):
        return speed * ticks
    # The way of the whole stop, less what it has covered in ``ticks``.
    return max(0.0, _from_cruise(top, change, jolt) - (top * ticks - jolt * ticks**3 / 6.0))


def _from_cruise(speed: float, change: float, jolt: float) -> float:
    """Way of a stop from a speed without acceleration: half the speed times its duration.

    The deceleration stays at ``change`` for a while, or returns to zero before it gets there.
    """
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
