"""One tick of one robot: a pure function of its plan, its state, the time, its samples and its target.

    target -> base frame -> model.inverse (seed: last command) -> limits -> transmission -> device values

The same arguments give the same bytes: no clock, no I/O, no global. The engine calls it at every deadline,
in real and in virtual time alike, and `contid replay` calls it with what was recorded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from contid.control.tick.config import RobotPlan
from contid.control.tick.faults import Fault
from contid.control.tick.limits import limit
from contid.control.tick.state import Effect, RobotState, fail, moved, speed, stay, stopped
from contid.control.tick.supervisor import Event, Mode
from contid.control.tick.tip_feedback import Measurement, corrected, kept, observed
from contid.hal import Sample
from contid.targets import Actuation, Solution, Target
from contid.trajectory.approach import Approach

#: How long a robot waits for a first valid sample of every axis, and for one after arming.
PATIENCE_S: Final = 2.0

_WATCHED: Final = frozenset(Mode) - {Mode.OFF, Mode.CONNECTING, Mode.FAULT}
_DRIVEN: Final = frozenset({Mode.APPROACH, Mode.RUN, Mode.HOLD, Mode.STOPPING, Mode.FAULT})


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a tick of one robot decided.

    Attributes:
        state: after the tick.
        device: commanded device values in the order of the axes, empty when nothing is commanded.
        solution: the model's answer when it was asked.
        tip_error_m: distance of the commanded model's tip from the (corrected) target; NaN without a target.
        limits: bits of `contid.control.tick.limits` per axis, empty when nothing was limited.
    """

    state: RobotState
    device: tuple[float, ...] = ()
    solution: Solution | None = None
    tip_error_m: float = math.nan
    limits: tuple[int, ...] = ()


def tick(
    plan: RobotPlan,
    state: RobotState,
    now_s: float,
    samples: tuple[Sample, ...],
    target: Target | None,
    measurement: Measurement | None = None,
) -> Outcome:
    """Decide what one robot does in this tick.

    Args:
        plan: what is fixed about the robot.
        state: after the previous tick and the orders since.
        now_s: time of the robot, one period per tick that ran.
        samples: newest of every axis, in the order of the plan; empty before the first.
        target: what the source wants of this robot now, in the world frame.
        measurement: newest measured tip, if anybody measures.
    """
    try:
        if state.mode in _WATCHED and samples:
            state = watched(plan, state, samples, now_s)
        mode = state.mode
        if mode is Mode.RUN and target is not None and state.follow:
            if plan.feedback is not None:
                load_n = plan.frame.vector_in_base(target.load_n)
                learnt = observed(plan, plan.feedback, state.correction, now_s, samples, measurement, load_n)
                state = replace(state, correction=learnt)
            return _follow(plan, state, now_s, target)
        if plan.feedback is not None:
            state = replace(state, correction=kept(plan.feedback, state.correction, now_s, measurement))
        if mode in (Mode.CONNECTING, Mode.READY, Mode.ARMING):
            return Outcome(_arming(plan, state, now_s, samples, target))
        if mode in (Mode.RUN, Mode.APPROACH) and state.goto is None and (target is None or not state.follow):
            state = stay(plan, state, now_s)
        elif mode is Mode.HOLD:
            wanted = state.goto if state.goto is not None else target if state.follow else None
            if wanted is not None:
                following = moved(plan, state, Event.FOLLOW, now_s)
                state = _approach(plan, following, wanted, now_s, now_s - plan.period_s)
        if state.mode not in _DRIVEN or not state.enabled:
            return Outcome(state)
        return _move(plan, state, now_s)
    except Exception as error:  # one robot's defect is that robot's fault, never the end of the others
        failed = fail(plan, state, Fault.INTERNAL, f"{type(error).__name__}: {error}", now_s)
        return Outcome(replace(failed, motion=None, aim=failed.command))


def watched(plan: RobotPlan, state: RobotState, samples: Sequence[Sample], now_s: float) -> RobotState:
    """The state after looking at the samples: misses counted, faults latched."""
    misses = state.misses
    if any(misses) or not all(sample.valid for sample in samples):
        misses = tuple(
            0 if sample.valid else count + 1 for sample, count in zip(samples, misses, strict=True)
        )
        state = replace(state, misses=misses)
    for sample, axis, stale_s in zip(samples, plan.axes, plan.stale_s, strict=True):
        if sample.fault:
            return fail(plan, state, Fault.DEVICE_FAULT, f"{axis}: {sample.fault}", now_s)
        if sample.valid and sample.age_s > stale_s:
            words = f"{axis} repeats a measurement that is {sample.age_s:.3g} s old"
            return fail(plan, state, Fault.AXIS_STALE, words, now_s)
    for count, tolerance, axis in zip(misses, plan.tolerance, plan.axes, strict=True):
        if count >= tolerance:
            words = f"{axis} did not answer {count} times in a row"
            return fail(plan, state, Fault.AXIS_SILENT, words, now_s)
    return state


def _arming(
    plan: RobotPlan, state: RobotState, now_s: float, samples: Sequence[Sample], target: Target | None
) -> RobotState:
    """From CONNECTING towards the first command; each step needs a valid sample of every axis."""
    sampled = bool(samples) and all(sample.valid and sample.value is not None for sample in samples)
    late = now_s - state.since_s > PATIENCE_S
    if state.mode is Mode.CONNECTING:
        if sampled:
            state = moved(plan, state, Event.SAMPLED, now_s)
        elif late:
            silent = [axis for axis, sample in zip(plan.axes, samples, strict=False) if not sample.valid]
            words = f"no valid sample of {', '.join(silent or plan.axes)} within {PATIENCE_S:g} s"
            return fail(plan, state, Fault.NO_SAMPLE, words, now_s)
    if state.mode is Mode.READY and state.wanted:
        # Commands of the time before are forgotten: whatever interrupts the arming must not go back to them.
        forgetful = replace(state, command=(), steps=(), aim=(), motion=None)
        return replace(moved(plan, forgetful, Event.ARM, now_s), pending=Effect.ENABLE, enabled=False)
    if state.mode is Mode.ARMING and state.enabled and sampled:
        present = plan.transmission.to_actuation(tuple(sample.value or 0.0 for sample in samples))
        still = (0.0,) * len(present)
        state = replace(state, command=present, aim=present, steps=still, motion=None)
        if target is None or not state.follow:
            return moved(plan, state, Event.HOLD, now_s)
        return _approach(plan, moved(plan, state, Event.ARMED, now_s), target, now_s, now_s)
    return state


def _approach(plan: RobotPlan, state: RobotState, target: Target, now_s: float, start_s: float) -> RobotState:
    """Begin the jerk-limited way from the last command, given at ``start_s``, to a target."""
    wanted = corrected(state.correction, plan.frame.target_in_base(target))
    goal = plan.model.inverse(wanted, state.command).actuation
    if not all(map(math.isfinite, goal)):
        return fail(plan, state, Fault.NOT_A_NUMBER, f"the model answered {goal}", now_s)
    motion = Approach(state.command, speed(plan, state), goal, plan.velocity, plan.acceleration, plan.jerk)
    return replace(state, motion=motion, motion_s=start_s)


def _follow(plan: RobotPlan, state: RobotState, now_s: float, target: Target) -> Outcome:
    """RUN: the model answers the target, the limiter has the last word."""
    in_base = corrected(state.correction, plan.frame.target_in_base(target))
    solution = plan.model.inverse(in_base, state.command)
    if not all(map(math.isfinite, solution.actuation)):
        words = f"the model answered {solution.actuation} to {in_base}"
        return _move(plan, fail(plan, state, Fault.NOT_A_NUMBER, words, now_s), now_s)
    after, flags = _limited(plan, state, solution.actuation)
    tip = plan.model.forward(after.command, in_base.load_n).tip_m
    wanted = in_base.tip_m
    if wanted is None:
        wanted = plan.model.forward(in_base.actuation or after.command, in_base.load_n).tip_m
    return Outcome(after, plan.transmission.to_device(after.command), solution, math.dist(tip, wanted), flags)


def _move(plan: RobotPlan, state: RobotState, now_s: float) -> Outcome:
    """Follow the running motion, or stand still, and take the step its end calls for."""
    aim = state.aim
    over = True
    if state.motion is not None:
        since_s = now_s - state.motion_s
        aim = state.motion.at(since_s)[0]
        over = since_s >= state.motion.duration_s
    after, flags = _limited(plan, state, aim)
    device = plan.transmission.to_device(after.command)
    # The limiter may lag behind (a motion that ends outside a limit): wait for standstill.
    if over and not any(after.steps):
        after = replace(after, motion=None, aim=after.command)
        if after.mode is Mode.APPROACH:
            after = _arrived(plan, after, now_s)
        elif after.mode is Mode.STOPPING:
            after = stopped(plan, after, now_s)
    return Outcome(after, device, None, math.nan, flags)


def _arrived(plan: RobotPlan, state: RobotState, now_s: float) -> RobotState:
    if state.goto is None:
        return moved(plan, state, Event.ARRIVED, now_s)
    return replace(moved(plan, state, Event.HOLD, now_s), goto=None)


def _limited(plan: RobotPlan, state: RobotState, aim: Actuation) -> tuple[RobotState, tuple[int, ...]]:
    """The state with its next command, and what limited it; limits count in ticks that ran."""
    last = state.command
    pace = [new - old for new, old in zip(aim, state.aim, strict=True)]
    command, flags = limit(plan.limits, last, state.steps, aim, pace)
    steps = tuple([new - old for new, old in zip(command, last, strict=True)])
    # Written out: `replace` costs three times as much, and this runs for every robot in every tick.
    after = RobotState(
        state.mode, state.since_s, state.fault, state.words, state.enabled, state.wanted, state.follow,
        state.goto, command, steps, aim, state.motion, state.motion_s, state.policy, state.misses,
        state.pending, state.correction,
    )  # fmt: skip
    return after, flags if any(flags) else ()
