"""Motions of the axes that no target gives: stops, and slow ones such as the way back inside the limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from contid.control.tick.config import RobotConfig
from contid.control.tick.state import FULL_PACE, AxisMotion, RobotState
from contid.control.tick.ways.joint_steps import within
from contid.targets import Actuation, Target
from contid.trajectory.approach import Approach, ApproachAfterStop
from contid.trajectory.pursuit import AxisRates, MovingAxes
from contid.trajectory.standstill import JerkLimitedStop, JointStop
from contid.trajectory.straight_stop import StraightStop

#: Share of an axis's travel beyond a limit that counts as outside; less is noise of a sensor or a zero.
OUTSIDE_SHARE: Final = 0.02
#: Share of velocity, acceleration and jerk of the motion inside.
RECOVER_SHARE: Final = 0.1
#: Shares of the time of a stop at which it is compared with the limits of the model.
_LOOKED_AT: Final = (0.25, 0.5, 0.75, 1.0)
#: Rounding of a number of ticks.
_ROUNDING: Final = 1e-6


def planned(state: RobotState, motion: AxisMotion | None, start_s: float) -> RobotState:
    """The state with a motion from its last command, given at ``start_s``.

    The reference is that command: one that was limited lags behind what it followed before.
    """
    return replace(state, motion=motion, motion_s=start_s, reference=state.command, squeeze=None, guard=None)


def shares_limits(config: RobotConfig) -> bool:
    """Whether axes share limits, which straight lines from standstill keep; False before motion rules 8."""
    return config.motion_rules > 7 and config.shared is not None


class PresentRates(NamedTuple):
    """How the axes of a robot move: their velocity [1/s] and acceleration [1/s^2]."""

    velocity: Actuation
    acceleration: Actuation

    @classmethod
    def at_rest(cls, axes: int) -> PresentRates:
        """Of axes that stand."""
        return cls((0.0,) * axes, (0.0,) * axes)

    @classmethod
    def at_end(cls, steps: Sequence[float], changes: Sequence[float], period_s: float) -> PresentRates:
        """Of the parabola through three commands, at the last: its last steps, and how they changed."""
        h = period_s
        velocity = tuple([(s + 0.5 * c) / h for s, c in zip(steps, changes, strict=True)])
        return cls(velocity, tuple([c / (h * h) for c in changes]))


def rates(config: RobotConfig, state: RobotState) -> PresentRates:
    """Rates at the last command, of the parabola through the last three.

    A motion that begins with them keeps the jerk from its first tick on. Motion rules 0 have the mean
    velocity of the last tick and no acceleration (`contid.control.tick.config.MOTION_RULES`). Since 8 the
    rates of a robot on its way to a live target are its own: it can stop from these, not always from those.
    """
    exact = state.guard.motion if state.guard is not None and config.motion_rules > 7 else None
    if exact is not None and exact.position == state.command:
        return PresentRates(exact.velocity, exact.acceleration)
    h = config.period_s
    if config.motion_rules == 0 or not state.before:
        return PresentRates(tuple([step / h for step in state.increments]), (0.0,) * len(state.increments))
    changes = [step - was for step, was in zip(state.increments, state.before, strict=True)]
    return PresentRates.at_end(state.increments, changes, h)


def _rates_of_motion(config: RobotConfig, state: RobotState, last_s: float) -> PresentRates:
    """`rates`; those of a running approach are its own where its axes share limits."""
    motion, since_s = state.motion, last_s - state.motion_s
    if not (shares_limits(config) and isinstance(motion, Approach) and state.reference == state.command):
        return rates(config, state)
    slowed = state.path_paces != FULL_PACE  # the clock of the motion is slower than that of the stop
    if slowed or not 0.0 < since_s < motion.duration_s:
        return rates(config, state)
    return PresentRates(motion.at(since_s).velocity, motion.acceleration_at(since_s))


def rates_along_path(config: RobotConfig, state: RobotState) -> PresentRates:
    """Rates at the last command by the clock of paths, which is slower where a body lags.

    A motion that begins with them, played by that clock, goes on as the robot moves.
    """
    if state.path_paces == FULL_PACE or not state.before:
        return rates(config, state)
    last_s, before_s = (pace * config.period_s for pace in state.path_paces[1:])
    middle_s = 0.5 * (last_s + before_s)
    mean = [step / last_s for step in state.increments]
    was = zip(mean, state.before, strict=True)
    acceleration = tuple([(velocity - step / before_s) / middle_s for velocity, step in was])
    rising = zip(mean, acceleration, strict=True)
    return PresentRates(tuple([v + 0.5 * a * last_s for v, a in rising]), acceleration)


def motion_to(
    config: RobotConfig, start: Actuation, begin: PresentRates, goal: Actuation, share: float = 1.0
) -> Approach:
    """From a position and its rates to a goal at rest, with a share of velocity, acceleration and jerk."""
    fastest, acceleration, jerk = (
        [share * rate for rate in limits] for limits in (config.velocity, config.acceleration, config.jerk)
    )
    return Approach(
        start, begin.velocity, goal, fastest, acceleration, jerk,
        straight=config.straight or shares_limits(config), start_acceleration=begin.acceleration,
    )  # fmt: skip


def approach_after_stop(
    config: RobotConfig, state: RobotState, goal: Actuation, start_s: float
) -> RobotState:
    """The state with the stop that runs and, a tick after its end, a straight line from there to a goal.

    Axes that share limits do not go elsewhere from motion. The whole way is one motion: what is checked or
    reported of a motion before it begins, such as its duration, is that of both parts.

    Args:
        config: of the robot.
        state: it stands, or stops by its motion (`braking`).
        goal: position of every axis at rest.
        start_s: of the last command.
    """
    stop = state.motion
    begin = state.command if stop is None else stop.at(stop.duration_s).position
    approach = motion_to(config, begin, PresentRates.at_rest(len(begin)), goal)
    if stop is None:
        return planned(state, approach, start_s)
    assert not isinstance(stop, ApproachAfterStop)
    ticks = math.ceil(stop.duration_s / config.period_s - _ROUNDING) + 1
    stop_s = max(ticks * config.period_s, start_s - state.motion_s)
    return replace(state, motion=ApproachAfterStop(stop, stop_s, approach))


def outside(config: RobotConfig, actuation: Actuation) -> str:
    """The axes that are outside their limits by more than `OUTSIDE_SHARE` of their travel; "" for none."""
    found = []
    for axis, value, each, quantity in zip(
        config.axes, actuation, config.limits, config.quantities, strict=True
    ):
        per_si, unit = quantity.per_si, quantity.unit
        inside = min(max(value, each.lower), each.upper)
        if abs(value - inside) > OUTSIDE_SHARE * (each.upper - each.lower):
            found.append(
                f"{axis} is at {value * per_si:.4g} {unit}, its limit is {inside * per_si:.4g} {unit}"
            )
    return "; ".join(found)


def inwards(config: RobotConfig, state: RobotState, start_s: float) -> RobotState:
    """The motion of every axis to its nearest limit, from the last command given at ``start_s``."""
    goal = tuple(
        min(max(value, each.lower), each.upper)
        for value, each in zip(state.command, config.limits, strict=True)
    )
    motion = motion_to(config, state.command, rates(config, state), goal, RECOVER_SHARE)
    return replace(planned(state, motion, start_s), goto=Target(actuation=goal), follow=False)


def braking(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    """The state with a jerk-limited stop from its present motion; none is needed at standstill.

    Live targets are followed so that the axes can stop inside the limits of the model, such as a bend radius.
    Where the jerk-limited stop, which is longer, goes beyond them, it is the shortest one. Since motion rules
    8 the jerk-limited stops are those with which live targets were compared, and an approach that rests as
    soon as its stop is not stopped: it ends inside.
    """
    if (running := _stop_that_runs(state)) is not None:
        return replace(state, motion=running, squeeze=None)
    velocity, acceleration = _rates_of_motion(config, state, now_s - config.period_s)
    if not any((*velocity, *acceleration)):
        return replace(state, motion=None, reference=state.command, squeeze=None, guard=None)
    last_s = now_s - config.period_s
    if shares_limits(config):
        begin = MovingAxes(state.command, velocity, acceleration)
        limits = AxisRates(config.velocity, config.acceleration, config.jerk)
        for straight in (True, False):
            stop = JointStop(begin, limits, straight=straight)
            if not _leaves(config, state.command, stop):
                return planned(state, stop, last_s)
        if _rests_within(state, stop.duration_s + config.period_s, last_s):
            return replace(state, squeeze=None)
        return braking_at_once(config, state, now_s)
    motion = JerkLimitedStop(state.command, velocity, config.acceleration, config.jerk, acceleration)
    if _leaves(config, state.command, motion):
        return braking_at_once(config, state, now_s)
    return planned(state, motion, last_s)


def _rests_within(state: RobotState, time_s: float, last_s: float) -> bool:
    """True for an approach on its way as planned that is over within a time after the last tick."""
    if not isinstance(state.motion, Approach) or state.reference != state.command:
        return False
    return state.motion.duration_s - (last_s - state.motion_s) <= time_s


def _stop_that_runs(state: RobotState) -> AxisMotion | None:
    """The stop of axes that share limits which goes on as planned; None for none."""
    if state.reference != state.command:
        return None
    if isinstance(state.motion, ApproachAfterStop):
        return state.motion.stop
    return state.motion if isinstance(state.motion, JointStop) else None


def _leaves(config: RobotConfig, command: Actuation, motion: JerkLimitedStop | JointStop) -> bool:
    """True when a stop goes from inside the limits of the model beyond them."""
    if config.taut is not None:  # its limiter keeps the tensions
        return False
    own = len(command) - config.extra_axes
    ways = [motion.at(share * motion.duration_s)[0] for share in _LOOKED_AT]
    inside = [within(config, at[:own], at[own:]) for at in (command, *ways)]
    return inside[0] and not all(inside)


def straight_stop(config: RobotConfig, command: Actuation, increments: Actuation) -> StraightStop:
    """The shortest stop from a command and the increment that led to it."""
    changes = [each.change for each in config.limits]
    ends = [(each.lower, each.upper) for each in config.limits]
    return StraightStop(command, increments, changes, ends, config.period_s)


def braking_at_once(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    """The state with the shortest stop from its present motion, in the mode it is in."""
    motion = straight_stop(config, state.command, state.increments) if any(state.increments) else None
    return planned(state, motion, now_s - config.period_s)
