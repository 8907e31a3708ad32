"""The closing of a tip on an object until a force, and its holding: the next share of the way of the axes.

The axes go on a straight line to the target (`squeeze_way`), and the force follows from the currents
(`squeeze_force`). The friction of gears that stand hides small changes of the force, so a range of forces
fits the currents: the estimate keeps its value while it lies in that range. So it grows with the currents
while the tip closes, and falls only when they show that the force is less.

Free, the tip closes at `CLOSING_M_S`; after the touch its speed is the missing force over the measured
stiffness: a slow integral, which is jerk-limited and stays between start and target. A pure function of its
inputs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.control.tick.squeezing import Squeeze, SqueezeEnd, SqueezeReport
from contid.hal import Sample
from contid.targets import Actuation, Target
from contid_contact.squeeze_force import CLOSING_M_S, FREE_S, SETTLE_S, fitting_n, measure_free
from contid_contact.squeeze_way import moved, tip_travel_m

#: Shortest way of the tip to its target: on its free part friction is measured, the rest lies in the object.
MIN_WAY_M: Final = 0.003
#: Time constants of the filter of the currents, and of the integral that holds the force [s].
_FILTER_S: Final = 0.015
_HOLDING_S: Final = 0.25
#: Bounds of the measured stiffness of an object together with the servos [N/m].
_SOFTEST: Final = 20.0
_HARDEST: Final = 1e4
#: Shares of the force to hold: a larger force is a touch; a smaller deviation counts as reached; a smaller
#: deviation is not corrected.
_TOUCH: Final = 0.3
_NEAR: Final = 0.1
_ALLOWED: Final = 0.02
#: Time for which the force must be near to count as reached, or gone to count as lost [s].
_SURE_S: Final = 0.1
#: A tip nearer than this to its target has reached it [m].
_THERE_M: Final = 2e-5


def why_not(config: RobotConfig, start: Actuation, target_in_base: Target) -> str:
    """Why a tip cannot close on an object at a target until a force; "" where it can."""
    goal = config.model.inverse(target_in_base, start).actuation
    ends = [config.model.forward(at).tip_m for at in (start, goal)]
    if math.dist(*ends) < MIN_WAY_M:
        return (
            f"its tip is {1e3 * math.dist(*ends):.1f} mm from the target, {1e3 * MIN_WAY_M:g} mm are needed"
        )
    return ""


def next_squeeze(
    config: RobotConfig, squeeze: Squeeze, samples: Sequence[Sample]
) -> tuple[Squeeze, SqueezeReport | None]:
    """The squeeze one period later, and the report of an end."""
    period_s = config.period_s
    travel_m = max(tip_travel_m(config, squeeze), 1e-6)
    closing = CLOSING_M_S / travel_m
    new = [sample.effort for sample in samples if sample.valid and sample.effort is not None]
    if len(new) < len(config.axes):
        return moved(config, squeeze, 0.0), None
    part = 1.0 - math.exp(-period_s / _FILTER_S)
    old = squeeze.currents or new
    currents = tuple([a + part * (b - a) for a, b in zip(old, new, strict=True)])
    squeeze = replace(squeeze, currents=currents)
    if squeeze.free_s < SETTLE_S + FREE_S:
        return measure_free(config, squeeze, travel_m)
    least_n, most_n = fitting_n(config, squeeze)
    # Where no force fits all axes, as when only one of them is held, that of the hardest pushing one counts.
    force_n = max(min(squeeze.force_n, most_n), least_n)
    squeeze = _touching(replace(squeeze, force_n=force_n), travel_m)
    if squeeze.stiffness == 0.0:
        if (1.0 - squeeze.share) * travel_m < _THERE_M:
            return squeeze, SqueezeReport(SqueezeEnd.NOTHING, force_n)
        return moved(config, squeeze, closing), None
    missing_n = squeeze.goal_n - force_n
    allowed_n = _ALLOWED * squeeze.goal_n
    acting_n = math.copysign(max(abs(missing_n) - allowed_n, 0.0), missing_n)
    rate = acting_n / (squeeze.stiffness * _HOLDING_S)
    after = moved(config, squeeze, min(max(rate, -closing), closing))
    return _held(after, missing_n, travel_m, period_s)


def _touching(squeeze: Squeeze, travel_m: float) -> Squeeze:
    """Detects a touch, and measures the stiffness on the way from half of its force to all of it."""
    if squeeze.stiffness > 0.0:
        return squeeze
    touch_n = _TOUCH * squeeze.goal_n
    if squeeze.force_n < 0.5 * touch_n:
        return replace(squeeze, touched=None)
    if squeeze.touched is None:
        return replace(squeeze, touched=squeeze.share)
    if squeeze.force_n < touch_n:
        return squeeze
    way_m = max((squeeze.share - squeeze.touched) * travel_m, 1e-9)
    stiffness = min(max(0.5 * touch_n / way_m, _SOFTEST), _HARDEST)
    return replace(squeeze, stiffness=stiffness * travel_m)


def _held(
    squeeze: Squeeze, missing_n: float, travel_m: float, period_s: float
) -> tuple[Squeeze, SqueezeReport | None]:
    """Counts the time for which the force is reached, or gone; the report when it was long enough."""
    if squeeze.reached:
        gone = squeeze.force_n < 0.5 * _TOUCH * squeeze.goal_n
        squeeze = replace(squeeze, sure_s=squeeze.sure_s + period_s if gone else 0.0)
        if squeeze.sure_s >= _SURE_S:
            return squeeze, SqueezeReport(SqueezeEnd.LOST, squeeze.force_n)
        return squeeze, None
    near = abs(missing_n) <= _NEAR * squeeze.goal_n
    squeeze = replace(squeeze, sure_s=squeeze.sure_s + period_s if near else 0.0)
    if squeeze.sure_s >= _SURE_S:
        return replace(squeeze, reached=True, sure_s=0.0), SqueezeReport(SqueezeEnd.REACHED, squeeze.force_n)
    if (1.0 - squeeze.share) * travel_m < _THERE_M and missing_n > 0.0:
        return squeeze, SqueezeReport(SqueezeEnd.NOTHING, squeeze.force_n)
    return squeeze, None
