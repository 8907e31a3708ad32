"""The closing of a tip on an object until a force, and its holding: the next share of the way of the axes.

The axes go on a straight line to the target, a share s of it at a time. On the free way the currents are the
friction f_i of every axis. From then on a force F, against the motion d of the tip, has to fit the current of
every axis, with N the torque per current and theta_i the rotation of the device:

    i_i - f_i <= c_i F <= i_i + f_i,      c_i = (dx/dtheta_i . d) / N

and stays what it was while it fits: gears that stand hide its changes. So it grows with the currents while
the tip closes, and is not taken back before they show that it is less.

Free, the tip closes at `CLOSING_M_S`; after the touch its speed is the missing force over the measured
stiffness: a slow integral, which is jerk-limited and stays between start and target. A pure function of its
inputs.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.hal import Sample
from contid.targets import Actuation, Target

#: Speed of the tip on the free way, and greatest one on its way back [m/s].
CLOSING_M_S: Final = 0.005
#: Part of the friction of the free way that may be more or less at the object.
FRICTION_CHANGE: Final = 0.2
#: Shortest way to the target: the free way to measure friction on, and what is behind the surface.
LEAST_WAY_M: Final = 0.003
#: At constant speed, how long the currents settle and are then averaged [s].
SETTLE_S: Final = 0.1
FREE_S: Final = 0.2
#: Time constant of the measured force, and of the holding [s].
_FILTER_S: Final = 0.015
_HOLDING_S: Final = 0.25
#: Stiffness of an object with its servos [N/m]: softer and harder ones are held as these.
_SOFTEST: Final = 20.0
_HARDEST: Final = 1e4
#: Share of the force to hold that is a touch, and how near to it the force has to be.
_TOUCH: Final = 0.3
_NEAR: Final = 0.1
#: Share of it that is left as it is.
_ALLOWED: Final = 0.02
#: Share of the force by which the free way must not grow harder.
_GROWTH: Final = 0.25
#: How long the force is near before it is reached, or gone before it is lost [s].
_SURE_S: Final = 0.1
#: Nearer than this to its target the tip is there [m].
_THERE_M: Final = 2e-5
#: Of the way, for the motion of the tip; greatest speed at the end of the way over what is left [1/s].
_STEP: Final = 1e-4
#: Of a device [rad]; axes that move the tip less than this along its way show nothing [m/rad].
_TURN: Final = 1e-4
_ALONG_M: Final = 1e-3
_ARRIVING: Final = 20.0


class SqueezeEnd(enum.Enum):
    """What a squeeze reports."""

    REACHED = "reached"  # the force is there; it is held
    LOST = "lost"  # the object is gone
    NOTHING = "nothing"  # the target came before the force
    PRESSED = "pressed"  # there was no free way to measure friction on
    WEAK = "weak"  # friction hides the force


@dataclass(frozen=True, slots=True)
class SqueezeReport:
    """The end of the closing or of the holding.

    Attributes:
        end: which.
        force_n: force of the tip along its motion then [N].
    """

    end: SqueezeEnd
    force_n: float


@dataclass(frozen=True, slots=True)
class Squeeze:
    """A tip that closes, or holds.

    Attributes:
        goal_n: force of the tip along its motion [N].
        start: command at the begin; empty before it.
        way: from there to the target.
        share: of the way, and its rate [1/s] and change of rate [1/s^2].
        free_s: time at constant speed.
        currents: filtered [A].
        free: mean currents of the free way, and of its first half [A].
        force_n: of the tip along its motion.
        touched: share of the way where half a touch was measured first, None before.
        stiffness: of what was touched [N per share], 0 before.
        sure_s: how long the force has been near, or gone.
        reached: it holds.
    """

    goal_n: float
    start: Actuation = ()
    way: Actuation = ()
    share: float = 0.0
    rate: float = 0.0
    change: float = 0.0
    free_s: float = 0.0
    currents: Actuation = ()
    free: tuple[Actuation, Actuation] = ((), ())
    force_n: float = 0.0
    touched: float | None = None
    stiffness: float = 0.0
    sure_s: float = 0.0
    reached: bool = False

    @property
    def reference(self) -> Actuation:
        """Where the axes have to be."""
        return _along(self, self.share)


def why_not(config: RobotConfig, start: Actuation, target_in_base: Target) -> str:
    """Why a tip cannot close on an object at a target until a force; "" where it can."""
    if not config.nm_per_a:
        return "no force follows from its currents without sense.nm_per_a in the robot file"
    goal = config.model.inverse(target_in_base, start).actuation
    ends = [config.model.forward(at).tip_m for at in (start, goal)]
    if math.dist(*ends) < LEAST_WAY_M:
        return (
            f"its tip is {1e3 * math.dist(*ends):.1f} mm from the target, {1e3 * LEAST_WAY_M:g} mm are needed"
        )
    return ""


def next_squeeze(
    config: RobotConfig, squeeze: Squeeze, samples: Sequence[Sample]
) -> tuple[Squeeze, SqueezeReport | None]:
    """The squeeze one period later, and the report of an end."""
    period_s = config.period_s
    travel_m = max(_travel_m(config, squeeze), 1e-6)
    closing = CLOSING_M_S / travel_m
    new = [sample.effort for sample in samples if sample.valid and sample.effort is not None]
    if len(new) < len(config.axes):
        return _moved(config, squeeze, 0.0), None
    part = 1.0 - math.exp(-period_s / _FILTER_S)
    old = squeeze.currents or new
    currents = tuple([a + part * (b - a) for a, b in zip(old, new, strict=True)])
    squeeze = replace(squeeze, currents=currents)
    if squeeze.free_s < SETTLE_S + FREE_S:
        return _measure_free(config, squeeze, travel_m)
    least_n, most_n = _fitting_n(config, squeeze)
    # Where no force fits all axes, as when only one of them is held, that of the hardest pushing one counts.
    force_n = max(min(squeeze.force_n, most_n), least_n)
    squeeze = _touching(replace(squeeze, force_n=force_n), travel_m)
    if squeeze.stiffness == 0.0:
        if (1.0 - squeeze.share) * travel_m < _THERE_M:
            return squeeze, SqueezeReport(SqueezeEnd.NOTHING, force_n)
        return _moved(config, squeeze, closing), None
    missing_n = squeeze.goal_n - force_n
    allowed_n = _ALLOWED * squeeze.goal_n
    acting_n = math.copysign(max(abs(missing_n) - allowed_n, 0.0), missing_n)
    rate = acting_n / (squeeze.stiffness * _HOLDING_S)
    after = _moved(config, squeeze, min(max(rate, -closing), closing))
    return _held(after, missing_n, travel_m, period_s)


def _measure_free(
    config: RobotConfig, squeeze: Squeeze, travel_m: float
) -> tuple[Squeeze, SqueezeReport | None]:
    """On the free way: the mean currents, which are friction, once the speed is constant."""
    if max(map(abs, squeeze.currents)) > config.usual_a:
        return squeeze, SqueezeReport(SqueezeEnd.PRESSED, 0.0)
    closing = CLOSING_M_S / travel_m
    after = _moved(config, squeeze, closing)
    if squeeze.share >= 1.0:
        return after, SqueezeReport(SqueezeEnd.NOTHING, 0.0)
    if squeeze.rate < 0.98 * min(closing, _fastest(config, squeeze)):
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
    turns = _turns(config, squeeze)
    unsure_nm = FRICTION_CHANGE * _work_nm(
        config, squeeze, [math.copysign(i, turn) for i, turn in zip(mean, turns, strict=True)]
    )
    growth_nm = 2.0 * _work_nm(config, squeeze, [a - b for a, b in zip(mean, early, strict=True)])
    if growth_nm > min(unsure_nm, _GROWTH * squeeze.goal_n * travel_m):  # something is in the way
        return after, SqueezeReport(SqueezeEnd.PRESSED, growth_nm / travel_m)
    if squeeze.goal_n * travel_m < unsure_nm:
        return after, SqueezeReport(SqueezeEnd.WEAK, unsure_nm / travel_m)
    return after, None


def _fitting_n(config: RobotConfig, squeeze: Squeeze) -> tuple[float, float]:
    """Least and greatest force that fits the currents [N]."""
    at = squeeze.reference
    tips = []
    for step in (0.0, _STEP):
        tips.append(config.model.forward(_along(squeeze, squeeze.share + step)).tip_m)
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


def _along(squeeze: Squeeze, share: float) -> Actuation:
    return tuple([a + share * b for a, b in zip(squeeze.start, squeeze.way, strict=True)])


def _work_nm(config: RobotConfig, squeeze: Squeeze, currents: Sequence[float]) -> float:
    """Work of currents per share of the way [N m]."""
    turns = _turns(config, squeeze)
    return config.nm_per_a * sum(i * turn for i, turn in zip(currents, turns, strict=True))


def _touching(squeeze: Squeeze, travel_m: float) -> Squeeze:
    """Notices a touch, and the stiffness by the way from half of it."""
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
    """Counts how long the force is there, or gone."""
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


def _moved(config: RobotConfig, squeeze: Squeeze, goal: float) -> Squeeze:
    """The next share of the way towards a rate [1/s], with the acceleration and jerk of every axis."""
    period_s = config.period_s
    acceleration, jerk = (
        min(limit / abs(part) for limit, part in zip(limits, squeeze.way, strict=True) if part)
        for limits in (config.acceleration, config.jerk)
    )
    fastest = _fastest(config, squeeze)
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


def _fastest(config: RobotConfig, squeeze: Squeeze) -> float:
    """Greatest rate of the share with every axis within its velocity [1/s]."""
    return min(limit / abs(part) for limit, part in zip(config.velocity, squeeze.way, strict=True) if part)


def _turns(config: RobotConfig, squeeze: Squeeze) -> list[float]:
    """Rotation of every device per share of the way [rad]; transmissions of rotations are linear."""
    ends = tuple([a + b for a, b in zip(squeeze.start, squeeze.way, strict=True)])
    to_device = config.transmission.to_device
    return [b - a for a, b in zip(to_device(squeeze.start), to_device(ends), strict=True)]


def _travel_m(config: RobotConfig, squeeze: Squeeze) -> float:
    """Travel of the tip per share of the way [m]."""
    ends = []
    for share in (squeeze.share - _STEP, squeeze.share + _STEP):
        ends.append(config.model.forward(_along(squeeze, share)).tip_m)
    return math.dist(*ends) / (2.0 * _STEP)
