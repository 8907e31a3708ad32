"""From READY to the first command: arming, the first approach, and approaches to later targets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from contid.control.tick.axis_motions import (
    approach_after_stop,
    inwards,
    motion_to,
    outside,
    planned,
    rates_along_path,
    shares_limits,
)
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.play import NO_LEAD
from contid.control.tick.shaping import NOT_SHAPED
from contid.control.tick.state import Effect, RobotState
from contid.control.tick.supervisor import Event, Mode
from contid.control.tick.tip_feedback import corrected
from contid.control.tick.transitions import apply_event, fail
from contid.hal import Sample
from contid.targets import Actuation, Target

#: Longest wait for a first valid sample of every axis.
FIRST_SAMPLE_TIMEOUT_S: Final = 2.0
#: Answers of the model that differ by less are the same, as a share of the travel of an axis.
SAME_SHARE: Final = 1e-4


def next_arming(
    config: RobotConfig, state: RobotState, now_s: float, samples: Sequence[Sample], target: Target | None
) -> RobotState:
    """From CONNECTING towards the first command; each step needs a valid sample of every axis."""
    present = config.measured_actuation(samples)
    late = now_s - state.since_s > FIRST_SAMPLE_TIMEOUT_S
    if state.mode is Mode.CONNECTING:
        if present is not None:
            state = apply_event(config, state, Event.SAMPLED, now_s)
        elif late:
            silent = [axis for axis, sample in zip(config.axes, samples, strict=False) if not sample.valid]
            message = (
                f"no valid sample of {', '.join(silent or config.axes)} within {FIRST_SAMPLE_TIMEOUT_S:g} s"
            )
            return fail(config, state, Fault.NO_SAMPLE, message, now_s)
    if state.mode is Mode.READY and state.arm_requested:
        # Old commands are dropped: an interrupted arming must not return to them.
        cleared = replace(
            state,
            command=(),
            increments=(),
            before=(),
            reference=(),
            motion=None,
            lead=NO_LEAD,
            shaped=NOT_SHAPED,
            was_armed=True,
        )
        return replace(
            apply_event(config, cleared, Event.ARM, now_s),
            pending=(*cleared.pending, Effect.ENABLE),
            enabled=False,
        )
    if state.mode is Mode.ARMING and state.enabled and present is not None:
        still = (0.0,) * len(present)
        state = replace(
            state, command=present, reference=present, increments=still, before=still, motion=None
        )
        if state.recovering:
            return inwards(config, apply_event(config, state, Event.ARMED, now_s), now_s)
        if far := outside(config, present):
            return fail(config, state, Fault.OUTSIDE_LIMITS, far, now_s)
        if target is None or not state.follow:
            return apply_event(config, state, Event.HOLD, now_s)
        return _first_approach(config, apply_event(config, state, Event.ARMED, now_s), target, now_s)
    return state


def _first_approach(config: RobotConfig, state: RobotState, target: Target, now_s: float) -> RobotState:
    """Begin the motion from where the axes stand to a first target.

    It is solved from rest, like that of the preflight: where a target has several solutions, the one that was
    checked is approached, wherever the axes stand. A loaded rod has to be led to it through its equilibria;
    from where the present ones lead elsewhere it goes to rest first.
    """
    present = state.command
    own = len(present) - config.extra_axes
    rest = (*config.rest[:own], *present[own:])
    if any(target.load_n) and _led_elsewhere(config, state, target, rest):
        to_rest = Target(actuation=config.rest[:own])
        return approach(config, replace(state, goto=to_rest), to_rest, now_s, now_s)
    return approach(config, state, target, now_s, now_s, rest)


def _led_elsewhere(config: RobotConfig, state: RobotState, target: Target, rest: Actuation) -> bool:
    """True when the answers to a target from the last command and from rest differ."""
    in_base = corrected(state.correction, config.frame.target_in_base(target))
    here, checked = (config.model.inverse(in_base, seed).actuation for seed in (state.command, rest))
    return any(
        abs(a - b) > SAME_SHARE * (each.upper - each.lower)
        for a, b, each in zip(here, checked, config.limits, strict=True)
    )


def approach(
    config: RobotConfig,
    state: RobotState,
    target: Target,
    now_s: float,
    start_s: float,
    seed: Actuation = (),
) -> RobotState:
    """Begin the jerk-limited motion from the last command, given at ``start_s``, to a target.

    Axes that share limits end the stop that they make first. The target is solved from ``seed``, or from the
    last command.
    """
    in_base = corrected(state.correction, config.frame.target_in_base(target))
    goal = config.model.inverse(in_base, seed or state.command).actuation
    if not all(map(math.isfinite, goal)):
        return fail(config, state, Fault.NOT_A_NUMBER, f"the model answered {goal}", now_s)
    if shares_limits(config):
        return approach_after_stop(config, state, goal, start_s)
    return planned(state, motion_to(config, state.command, rates_along_path(config, state), goal), start_s)
