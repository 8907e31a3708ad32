"""One tick of one robot: a pure function of its configuration, state, time, samples and target.

    target -> base frame -> model.inverse (seed: last command) -> limits -> transmission -> device values

The same arguments give the same bytes: no clock, no I/O, no global. The engine calls it at every deadline,
in real and in virtual time alike, and `contid replay` calls it with what was recorded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from contid.control.tick.arming import approach, next_arming
from contid.control.tick.axis_motions import braking, braking_at_once, inwards
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault, of_device
from contid.control.tick.follow.model_answer import answered
from contid.control.tick.jerk_guard import Guarded, guarded
from contid.control.tick.limits import ACCELERATION
from contid.control.tick.next_command import next_command
from contid.control.tick.play import led, next_lead
from contid.control.tick.regulator_loops import next_loop_lead
from contid.control.tick.shaping import next_shaped
from contid.control.tick.squeezing import Squeeze, SqueezeEnd, SqueezeReport
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Event, Mode
from contid.control.tick.taut import lifted
from contid.control.tick.tip_feedback import Measurement, corrected, kept, observed
from contid.control.tick.transitions import apply_event, end_stop, fail, stay
from contid.hal import Sample
from contid.records import record
from contid.targets import ZERO3, Actuation, Solution, Target, Vec3
from contid.trajectory.approach import Approach, ApproachAfterStop

_WATCHED: Final = frozenset(Mode) - {Mode.OFF, Mode.CONNECTING, Mode.FAULT}
_DRIVEN: Final = frozenset({Mode.APPROACH, Mode.RUN, Mode.HOLD, Mode.STOPPING, Mode.FAULT})


@record(frozen=True, slots=True)
class TickResult:
    """Result of a tick of one robot.

    Attributes:
        state: after the tick.
        device: commanded device values in the order of the axes, empty when nothing is commanded.
        solution: of the model, None when it was not solved.
        tip_error_m: distance of the commanded model's tip from the (corrected) target; NaN without a target.
        limits: bits of `contid.control.tick.limits` per axis, empty when nothing was limited.
        squeezed: the report of a tip that closes or holds, None for none.
        held: a stage stopped the robot in this tick (`contid.control.engine.stages`).
    """

    state: RobotState
    device: tuple[float, ...] = ()
    solution: Solution | None = None
    tip_error_m: float = math.nan
    limits: tuple[int, ...] = ()
    squeezed: SqueezeReport | None = None
    held: bool = False

    @property
    def arrived(self) -> bool:
        """False when a stage stopped the robot, or a move until a force ended without it."""
        return not self.held and (self.squeezed is None or self.squeezed.end is SqueezeEnd.REACHED)


def tick(
    config: RobotConfig,
    state: RobotState,
    now_s: float,
    samples: tuple[Sample, ...],
    target: Target | None,
    measurement: Measurement | None = None,
    *,
    live: bool = False,
) -> TickResult:
    """Run one tick of one robot.

    Args:
        config: of the robot.
        state: after the previous tick and the orders since.
        now_s: time of the robot, one period per tick that ran.
        samples: newest of every axis, in the order of the axes; empty before the first.
        target: of the source, in the world frame.
        measurement: newest measured tip, None without a tracker.
        live: the target belongs to a live stream, whose jerk was not checked.
    """
    try:
        if state.mode in _WATCHED and samples:
            state = watched(config, state, samples, now_s)
        mode = state.mode
        if mode is Mode.RUN and target is not None and state.follow:
            if config.feedback is not None:
                load_n = config.frame.vector_in_base(target.load_n)
                learnt = observed(
                    config,
                    config.feedback,
                    state.correction,
                    now_s,
                    samples,
                    measurement,
                    load_n,
                    state.lead.ahead(state.shaped.acting or state.command),
                )
                state = replace(state, correction=learnt)
            return _follow(config, state, now_s, target, live)
        if config.feedback is not None:
            held = kept(config.feedback, state.correction, now_s, measurement, config.motion_rules)
            state = replace(state, correction=held)
        if mode in (Mode.CONNECTING, Mode.READY, Mode.ARMING):
            return TickResult(next_arming(config, state, now_s, samples, target))
        if mode in (Mode.RUN, Mode.APPROACH) and state.goto is None and (target is None or not state.follow):
            state = stay(config, state, now_s)
        elif mode is Mode.HOLD and state.recovering:
            state = inwards(config, apply_event(config, state, Event.RECOVER, now_s), now_s - config.period_s)
        elif mode is Mode.HOLD:
            next_target = state.goto if state.goto is not None else target if state.follow else None
            if next_target is not None and state.squeeze is not None:
                state = _close(config, state, next_target, now_s)
            elif next_target is not None:
                following = apply_event(config, state, Event.FOLLOW, now_s)
                start_s = now_s - state.path_paces[0] * config.period_s
                state = approach(config, following, next_target, now_s, start_s)
        if state.mode not in _DRIVEN or not state.enabled:
            return TickResult(state)
        if state.squeeze is not None and state.squeeze.start:
            return _squeezed(config, state, state.squeeze, now_s, samples)
        if state.mode is Mode.HOLD and _stands(config, state):
            return TickResult(state, config.transmission.to_device(state.command))
        going_to = state.goto if state.goto is not None else target
        return _move(config, state, now_s, ZERO3 if going_to is None else going_to.load_n)
    except (Exception, SystemExit) as error:  # an error in one robot must not stop the others
        failed = fail(config, state, Fault.INTERNAL, f"{type(error).__name__}: {error}", now_s)
        return stop_without_model(config, failed, now_s)


def tick_again(
    config: RobotConfig, state: RobotState, now_s: float, samples: tuple[Sample, ...]
) -> TickResult:
    """The tick of a robot that a stage made stop, from the state in which it does; without a target."""
    return replace(tick(config, state, now_s, samples, None), held=True)


def _stands(config: RobotConfig, state: RobotState) -> bool:
    """True for a robot whose next state and command are those it has: nothing has to be computed."""
    return (
        state.motion is None
        and state.reference == state.command
        and not any(state.increments)
        and not any(state.before)
        and not state.straight
        and config.play is None
        and config.capstan is None
        and config.loops is None
        and state.shaped.ticks_left == 0
    )


def stop_without_model(config: RobotConfig, failed: RobotState, now_s: float) -> TickResult:
    """The first command of a stop that asks no model; none when what leads to the devices failed."""
    try:
        if failed.enabled:
            return _move(config, failed, now_s)
    except Exception:  # the message is that of the first error
        failed = replace(failed, motion=None, reference=failed.command)
    return TickResult(failed)


def watched(config: RobotConfig, state: RobotState, samples: Sequence[Sample], now_s: float) -> RobotState:
    """The state after checking the samples: misses counted, faults latched."""
    misses = state.misses
    for sample, stale_s in zip(samples, config.stale_s, strict=True):
        if sample.fault or not sample.valid or sample.age_s > stale_s:
            break
    else:
        if not any(misses):  # the usual case
            return state
    if any(misses) or not all(sample.valid for sample in samples):
        misses = tuple(
            [0 if sample.valid else count + 1 for sample, count in zip(samples, misses, strict=True)]
        )
        state = replace(state, misses=misses)
    for sample, axis, stale_s in zip(samples, config.axes, config.stale_s, strict=True):
        if sample.fault:
            return fail(config, state, of_device(sample.fault), f"{axis}: {sample.fault}", now_s)
        if sample.valid and sample.age_s > stale_s:
            message = f"{axis} repeats a measurement that is {sample.age_s:.3g} s old"
            return fail(config, state, Fault.AXIS_STALE, message, now_s)
    for count, tolerance, axis, sample in zip(misses, config.tolerance, config.axes, samples, strict=True):
        if count >= tolerance:
            # A failed read keeps the last value; none is left only where the driver answered no number.
            if sample.value is None:
                message = f"{axis} answered {count} times in a row, but not with a finite number"
                return fail(config, state, Fault.IMPLAUSIBLE_SAMPLE, message, now_s)
            message = f"{axis} did not answer {count} times in a row"
            return fail(config, state, Fault.AXIS_SILENT, message, now_s)
    return state


def _close(config: RobotConfig, state: RobotState, target: Target, now_s: float) -> RobotState:
    """Begin to close on an object, once the robot stands."""
    assert state.squeeze is not None
    if any(state.increments):
        return state
    in_base = corrected(state.correction, config.frame.target_in_base(target))
    goal = config.model.inverse(in_base, state.command).actuation
    if not all(map(math.isfinite, goal)):
        return fail(config, state, Fault.NOT_A_NUMBER, f"the model answered {goal}", now_s)
    way = tuple([b - a for a, b in zip(state.command, goal, strict=True)])
    squeeze = replace(state.squeeze, start=state.command, way=way)
    return replace(apply_event(config, state, Event.FOLLOW, now_s), motion=None, squeeze=squeeze)


def _squeezed(
    config: RobotConfig, state: RobotState, squeeze: Squeeze, now_s: float, samples: Sequence[Sample]
) -> TickResult:
    """Close on an object, or hold it; where that ends stop jerk-limited."""
    assert config.squeezes is not None
    squeeze, report = config.squeezes.next_squeeze(config, squeeze, samples)
    if report is not None and report.end is not SqueezeEnd.REACHED:
        if state.mode is Mode.HOLD:
            ended = braking(config, state, now_s)
        else:
            ended = replace(stay(config, state, now_s), goto=None)
        return replace(_move(config, ended, now_s), squeezed=report)
    result = _limited(config, state, squeeze.reference)
    after = replace(result.state, squeeze=squeeze)
    if report is not None:
        after = replace(apply_event(config, after, Event.HOLD, now_s), goto=None)
    return replace(result, state=after, squeezed=report)


def _follow(config: RobotConfig, state: RobotState, now_s: float, target: Target, live: bool) -> TickResult:
    """RUN: solve the model for the target, then limit; on a live stream the jerk of the axes as well."""
    in_base = config.frame.target_in_base(target)
    if config.feedback is not None:
        in_base = corrected(state.correction, in_base)
    answer = answered(config, state, in_base)
    solution = answer.solution
    if not all(map(math.isfinite, solution.actuation)):
        message = f"the model answered {solution.actuation} to {in_base}"
        return _move(config, fail(config, state, Fault.NOT_A_NUMBER, message, now_s), now_s)
    goal, guard = solution.actuation, None
    if live:
        if config.taut is not None and config.motion_rules > 0 and in_base.actuation is None:
            goal = lifted(config.taut, config.lift_n, goal)
        guard = guarded(config, state, goal)
    result = _limited(config, state, goal if guard is None else guard.command, in_base, guard, goal)
    command = result.state.command
    tip = config.model.forward(command, in_base.load_n).tip_m
    target_tip = in_base.tip_m
    if target_tip is None:
        asked = solution.actuation if in_base.arcs else in_base.actuation or command
        target_tip = tip if asked == command else config.model.forward(asked, in_base.load_n).tip_m
    after = result.state if solution.converged else replace(result.state, missed=answer)
    return TickResult(after, result.device, solution, math.dist(tip, target_tip), result.limits)


def _move(config: RobotConfig, state: RobotState, now_s: float, load_n: Vec3 = ZERO3) -> TickResult:
    """Follow the running motion or stand still; change the mode at its end."""
    reference = state.reference
    over = True
    if isinstance(state.motion, ApproachAfterStop) and now_s - state.motion_s >= state.motion.stop_s:
        begun_s = state.motion_s + state.motion.stop_s
        state = replace(state, motion=state.motion.approach, motion_s=begun_s)
    if state.motion is not None:
        since_s = now_s - state.motion_s
        reference = state.motion.at(since_s)[0]
        over = since_s >= state.motion.duration_s
        behind = since_s > state.motion.duration_s + 1.5 * config.period_s and any(state.increments)
        together = config.shared is not None or config.taut is not None
        if behind and together and not isinstance(state.motion, Approach):
            # A limit that axes share kept it from the end of its stop: it stops where it is.
            state = braking_at_once(config, state, now_s)
            reference = state.motion.at(config.period_s)[0] if state.motion is not None else reference
    goal = state.motion.goal if isinstance(state.motion, Approach) else ()
    result = _limited(config, state, reference, goal=goal, load_n=load_n)
    after, flags = result.state, result.limits
    if not flags and after.command != reference:
        # On its way back to the motion it comes no faster than it can brake.
        pairs = zip(after.command, reference, strict=True)
        flags = tuple([0 if value == planned_value else ACCELERATION for value, planned_value in pairs])
    # The limiter may lag behind (a motion that ends outside a limit): wait for standstill.
    if over and not any(after.increments) and after.shaped.ticks_left == 0:
        after = replace(after, motion=None, reference=after.command)
        if after.mode is Mode.APPROACH:
            after = _arrived(config, after, now_s)
        elif after.policy is not None:
            after = end_stop(config, after, now_s)
    return TickResult(after, result.device, limits=flags)


def _arrived(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    if state.goto is None:
        return apply_event(config, state, Event.ARRIVED, now_s)
    return replace(apply_event(config, state, Event.HOLD, now_s), goto=None, recovering=False)


def _limited(
    config: RobotConfig,
    state: RobotState,
    reference: Actuation,
    target_in_base: Target | None = None,
    guard: Guarded | None = None,
    answer: Actuation = (),
    *,
    goal: Actuation = (),
    load_n: Vec3 = ZERO3,
) -> TickResult:
    """The state with its next command, and the limits that bound; skipped ticks do not count.

    Args:
        config: of the robot.
        state: after the tick before.
        reference: where the axes have to go.
        target_in_base: what the reference answers; None for a motion of the axes.
        guard: of the jerk on a live stream, whose command the reference is; None without.
        answer: of the model to the live target; the limiter gets a motion that it may follow where the axes
            cannot be on it.
        goal: where the motion goes, which chooses how it is shaped; the reference when left out.
        load_n: known force on the tip, which chooses that as well.
    """
    last = state.command
    guard_state, guard_flags = (state.guard, ()) if guard is None else (guard.state, guard.flags)
    before_it = last if guard_flags else state.reference
    target_step = [new - old for new, old in zip(reference, before_it, strict=True)]
    command, flags, straight = next_command(
        config,
        last,
        state.increments,
        reference,
        target_step,
        target_in_base,
        state.straight,
        guard is not None,
    )
    if guard_flags:
        flags = tuple([a | b for a, b in zip(flags, guard_flags, strict=True)])
        reference = answer
    increments = tuple([new - old for new, old in zip(command, last, strict=True)])
    acting, acting_steps, shaped = command, increments, state.shaped
    if config.shaping is not None:
        load_n = load_n if target_in_base is None else target_in_base.load_n
        shaped = next_shaped(config.shaping.shaper, shaped, last, command, goal or reference, load_n)
        acting = shaped.acting
        before = state.shaped.acting or last
        acting_steps = tuple([new - old for new, old in zip(acting, before, strict=True)])
    lead = state.lead
    if config.play is not None or config.capstan is not None:
        lead = next_lead(config.play, config.capstan, lead, acting, acting_steps, config.limits)
    elif config.loops is not None:
        lead = next_loop_lead(config.loops, lead, acting, config.limits, config.period_s)
    # Written out: `replace` costs three times as much, and this runs for every robot in every tick.
    after = RobotState(
        state.mode, state.since_s, state.fault, state.message, state.enabled, state.arm_requested,
        state.follow, state.goto, command, increments, state.increments, reference, state.motion,
        state.motion_s, state.policy, state.misses, state.pending, state.correction, state.recovering, lead,
        straight, state.squeeze, guard_state, shaped, state.was_armed, state.path_paces,
    )  # fmt: skip
    device = config.transmission.to_device(led(acting, lead.added) if lead.added else acting)
    return TickResult(after, device, limits=flags if any(flags) else ())
