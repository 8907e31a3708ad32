"""The force of a closing tip from the currents of its axes, and their friction from the free way.

On the free way the currents are the friction f_i of every axis. From then on a force F, against the motion d
of the tip, has to fit the current of every axis, with N the torque per current and theta_i the rotation of
the device:

    i_i - f_i <= c_i F <= i_i + f_i,      c_i = (dx/dtheta_i . d) / N
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.control.tick.squeezing import Squeeze, SqueezeEnd, SqueezeReport, actuation_at
from contid_contact.squeeze_way import STEP, device_turns, greatest_rate, moved

#: Speed of the tip on the free way, and greatest one on its way back [m/s].
CLOSING_M_S: Final = 0.005
#: Part of the friction of the free way that may be more or less at the object.
FRICTION_CHANGE: Final = 0.2
#: At constant speed, how long the currents settle and are then averaged [s].
SETTLE_S: Final = 0.1
FREE_S: Final = 0.2
#: Share of the force by which the free way must not grow harder.
_GROWTH: Final = 0.25
#: Of a device [rad]; axes that move the tip less than this along its way show nothing [m/rad].
_TURN: Final = 1e-4
_ALONG_M: Final = 1e-3


def measure_free(
    config: RobotConfig, squeeze: Squeeze, travel_m: float
) -> tuple[Squeeze, SqueezeReport | None]:
    """On the free way: the mean currents, which are friction, once the speed is constant."""
    if max(map(abs, squeeze.currents)) > config.usual_a:
        return squeeze, SqueezeReport(SqueezeEnd.PRESSED, 0.0)
    closing = CLOSING_M_S / travel_m
    after = moved(config, squeeze, closing)
    if squeeze.share >= 1.0:
        return after, SqueezeReport(SqueezeEnd.NOTHING, 0.0)
    if squeeze.rate < 0.98 * min(closing, greatest_rate(config, squeeze)):
        return after, None
    free_s, (mean, early) = squeeze.free_s + config.period_s, squeeze.free
    if free_s > SETTLE_S:
        count = max(round((free_s - SETTLE_S) / config.period_s), 1)
        mean = mean or squeeze.currents
        mean = tuple([a + (i - a) / count for a, i in zip(mean, squeeze.currents, strict=True)])
        early = mean if free_s <= SETTLE_S + 0.5 * FREE_S else early
    after = replace(after, free_s=free_s, free=(mean, early))
    if free_s < SETTLE_S + FREE_S:
        return after, None
    turns = device_turns(config, squeeze)
    unsure_nm = FRICTION_CHANGE * _work_nm(
        config, squeeze, [math.copysign(i, turn) for i, turn in zip(mean, turns, strict=True)]
    )
    growth_nm = 2.0 * _work_nm(config, squeeze, [a - b for a, b in zip(mean, early, strict=True)])
    if squeeze.goal_n * travel_m < unsure_nm:  # first: so small a growth of the currents is noise
        return after, SqueezeReport(SqueezeEnd.WEAK, unsure_nm / travel_m)
    if growth_nm > min(unsure_nm, _GROWTH * squeeze.goal_n * travel_m):  # something is in the way
        return after, SqueezeReport(SqueezeEnd.PRESSED, growth_nm / travel_m)
    return after, None


def fitting_n(config: RobotConfig, squeeze: Squeeze) -> tuple[float, float]:
    """Least and greatest force that fits the currents [N]."""
    at = squeeze.reference
    tips = []
    for step in (0.0, STEP):
        tips.append(config.model.forward(actuation_at(squeeze, squeeze.share + step)).tip_m)
    way = [b - a for a, b in zip(*tips, strict=True)]
    length = max(math.hypot(*way), 1e-12)
    least_n, most_n = -math.inf, math.inf
    turned = config.transmission.to_device(at)
    for axis, (current, free) in enumerate(zip(squeeze.currents, squeeze.free[0], strict=True)):
        device = list(turned)
        device[axis] += _TURN
        tip = config.model.forward(config.transmission.to_actuation(tuple(device))).tip_m
        along = sum((b - a) * w for a, b, w in zip(tips[0], tip, way, strict=True)) / length / _TURN
        if abs(along) < _ALONG_M:
            continue
        ends = [config.nm_per_a * (current + sign * abs(free)) / along for sign in (-1.0, 1.0)]
        least_n, most_n = max(least_n, min(ends)), min(most_n, max(ends))
    return least_n, most_n


def _work_nm(config: RobotConfig, squeeze: Squeeze, currents: Sequence[float]) -> float:
    """Work of currents per share of the way [N m]."""
    turns = device_turns(config, squeeze)
    return config.nm_per_a * sum(i * turn for i, turn in zip(currents, turns, strict=True))
