"""Closed loop on the tip: an integral correction of the model's error from measured tip positions.

Let y be the measured tip, q the *measured* actuation and m(q) the model's tip for it. The model's error
d = y - m(q) is estimated by a first-order filter of gain K, and the model is asked for ``r - d``::

    d' = K (y - m(q) - d)          m(q_command) = r - d

At rest the robot is where it was commanded, m(q) = r - d, so ``d' = K (y - r)``: the correction integrates
the tip's error, and in the end y = r whatever the model got wrong. Because d compares the measurement with
where the actuators *are*, neither their lag nor a limit that binds charges it: nothing winds up; the bound
on d only guards against wrong measurements. Without a measurement d holds for a while, then fades to zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from contid.control.tick.config import MOTION_RULES, FeedbackConfig, RobotConfig
from contid.control.tick.play import led
from contid.hal import Sample
from contid.targets import ZERO3, Actuation, Target, Vec3


@dataclass(frozen=True, slots=True)
class Measurement:
    """A measured tip.

    Attributes:
        tip_in_world: position [m].
        time_s: when it was captured, in the time of the tick.
        direction_in_world: unit tangent there; recorded and shown, the feedback does not use it.
    """

    tip_in_world: Vec3
    time_s: float
    direction_in_world: Vec3 | None = None


@dataclass(frozen=True, slots=True)
class Correction:
    """State of the feedback of one robot.

    Attributes:
        error_m: filtered error of the model in the base frame (d above).
        seen_m: error by the newest measurement (y - m(q) above); the filter runs towards it in every tick,
            so measurements slower than the tick do not make steps.
        used_s: time of that measurement; -inf before the first.
        faded_from_m: the filtered error when fading began.
    """

    error_m: Vec3 = ZERO3
    seen_m: Vec3 = ZERO3
    used_s: float = -math.inf
    faded_from_m: Vec3 = ZERO3


def corrected(correction: Correction, target: Target) -> Target:
    """The target for the model; only tip targets are corrected."""
    if target.tip_m is None or correction.error_m == ZERO3:
        return target
    return replace(target, tip_m=_minus(target.tip_m, correction.error_m))


def observed(
    config: RobotConfig,
    feedback: FeedbackConfig,
    before: Correction,
    now_s: float,
    samples: tuple[Sample, ...],
    measurement: Measurement | None,
    load_n: Vec3,
    ahead: Actuation = (),
) -> Correction:
    """The correction after this tick.

    Args:
        config: of the robot.
        feedback: its numbers.
        before: after the previous tick.
        now_s: of this tick.
        samples: newest of every axis.
        measurement: newest there is, also an old one.
        load_n: known force on the tip, in the base frame.
        ahead: by what the devices are ahead of their axes, for play and friction.
    """
    seen_m, used_s = before.seen_m, before.used_s
    newer = measurement if measurement is not None and measurement.time_s > used_s else None
    if newer is not None and (actuation := config.measured_actuation(samples)) is not None:
        delivered = led(actuation, tuple([-lead for lead in ahead]))
        model_tip = config.model.forward(delivered, load_n).tip_m
        error_m = _minus(config.frame.point_in_base(newer.tip_in_world), model_tip)
        if all(map(math.isfinite, error_m)):
            seen_m, used_s = _bounded(error_m, feedback.limit_m), newer.time_s
    if now_s - used_s > feedback.stale_s:
        return _faded(feedback, before, now_s)
    share = -math.expm1(-feedback.gain_per_s * config.period_s)
    (dx, dy, dz), (ex, ey, ez) = before.error_m, seen_m
    filtered = (dx + share * (ex - dx), dy + share * (ey - dy), dz + share * (ez - dz))
    return Correction(filtered, seen_m, used_s, filtered)


def kept(
    feedback: FeedbackConfig,
    before: Correction,
    now_s: float,
    measurement: Measurement | None,
    rules: int = MOTION_RULES,
) -> Correction:
    """The correction of a robot without a target: kept while measurements come, else it fades.

    One that began to fade between two measurements is whole again with the next; none moves the robot.
    ``rules``: of motion.
    """
    if before.error_m == ZERO3:
        return before
    if measurement is not None and measurement.time_s > before.used_s:
        whole = before.faded_from_m if rules > 4 else before.error_m
        before = replace(before, used_s=measurement.time_s, error_m=whole, faded_from_m=whole)
    return _faded(feedback, before, now_s)


def _faded(feedback: FeedbackConfig, before: Correction, now_s: float) -> Correction:
    """Hold, then fade as ``1 - 3u^2 + 2u^3``: it begins and ends without a kink."""
    if before.error_m == ZERO3:
        return before
    u = (now_s - before.used_s - feedback.stale_s) / feedback.fade_s
    if u <= 0.0:
        return before
    if u >= 1.0:
        return Correction(used_s=before.used_s)
    left = 1.0 - u * u * (3.0 - 2.0 * u)
    x, y, z = before.faded_from_m
    return Correction((x * left, y * left, z * left), before.seen_m, before.used_s, before.faded_from_m)


def _bounded(error_m: Vec3, limit_m: float) -> Vec3:
    """An error no longer than the limit."""
    size = math.hypot(*error_m)
    scale = 1.0 if size <= limit_m else limit_m / size
    return (error_m[0] * scale, error_m[1] * scale, error_m[2] * scale)


def _minus(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
