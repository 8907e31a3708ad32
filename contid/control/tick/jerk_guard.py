"""Velocity, acceleration and jerk of every axis hold in every tick of a live stream, whatever its targets do.

The answer of the model to a target is commanded as it is where the axes can be on it in this tick and go on
with it, within the limits of the robot file. Where they cannot - a row that jumps, a path that is too fast, a
robot that has to catch up - all axes go to it together by the shortest motion within these limits
(`contid.trajectory.pursuit`), until they can be on it again.

Everything is judged by differences of commands, one period h apart: the step s, its change c and the change u
of that, bounded by ``v h``, ``a h^2`` and ``j h^3``. The parabola through the last three commands has the
velocity ``s + c/2`` and the acceleration c at the last one; a motion that begins there with a jerk within j
has third differences within ``j h^3`` from its first sample on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import ACCELERATION
from contid.control.tick.state import GuardState, RobotState
from contid.targets import Actuation
from contid.trajectory.approach import optimal
from contid.trajectory.pursuit import AxisRates, MovingAxes, braked, frame_velocity, pursued, stopping

#: A bound counts as kept up to this share of it: rounding.
_SLACK: Final = 1.0 + 1e-6
#: Greatest slope of a shared limit along one axis, and excess of one that is rounding [m]
#: (`contid.control.tick.shared_limits`).
_STEEPEST: Final = 2.0
_ROUNDING_M: Final = 1e-12
#: Share of the velocity below which an axis counts as moving with it, for how far a stop can lead.
_SLOW: Final = 0.05
#: States of a stop that are compared with the limits that axes share.
_LOOKED_AT: Final = 4


@dataclass(frozen=True, slots=True)
class Guarded:
    """What the axes are to do in a tick.

    Attributes:
        command: of every axis; the answer itself where they can be on it.
        state: of the guard after the tick.
        flags: per axis the limits that bound, empty for none.
    """

    command: Actuation
    state: GuardState
    flags: tuple[int, ...] = ()


def guarded(config: RobotConfig, state: RobotState, answer: Actuation) -> Guarded:
    """The command towards the model's answer to a live target.

    Args:
        config: of the robot.
        state: after the tick before.
        answer: of the model to the target of this tick; finite.
    """
    before = state.guard
    joins = before is None or before.joined_s != state.since_s
    if before is None or joins:
        before = GuardState(state.since_s, (0.0,) * len(answer), None)
    # Motion rules 0 take the acceleration of the tick in which a robot begins to follow for zero.
    last_steps = state.increments if joins and config.motion_rules == 0 else state.before or state.increments
    paces = tuple([new - old for new, old in zip(answer, state.reference, strict=True)])
    changes = tuple([s - was for s, was in zip(state.increments, last_steps, strict=True)])
    after = GuardState(state.since_s, paces, None)
    unguarded = config.taut is not None or not optimal()  # tendons have a limiter that keeps tensions
    if unguarded or _on(config, state, changes, answer, before.paces):
        return Guarded(answer, after)
    motion = _pursuing(config, state, before, changes, answer)
    flags = tuple(
        [ACCELERATION if new != there else 0 for new, there in zip(motion.position, answer, strict=True)]
    )
    after = GuardState(state.since_s, paces, motion)
    return Guarded(motion.position, after, flags)


def _on(
    config: RobotConfig, state: RobotState, changes: Actuation, answer: Actuation, paces: Actuation
) -> bool:
    """True when every axis may be on its answer in this tick, and on it if it goes on in the two next."""
    h = config.period_s
    for index, there in enumerate(answer):
        limits = config.limits[index]
        top, change, jolt = (
            limits.step * _SLACK,
            limits.change * _SLACK,
            config.jerk[index] * h * h * h * _SLACK,
        )
        last = state.command[index]
        step = there - last
        c1 = step - state.increments[index]
        pace = there - state.reference[index]
        bend = pace - paces[index]
        c2 = pace + bend - step
        if (
            abs(step) > top
            or abs(c1) > change
            or abs(c1 - changes[index]) > jolt
            or abs(c2) > change
            or abs(c2 - c1) > jolt
            or abs(bend - c2) > jolt
            or not _viable(config, index, there, step + 0.5 * c1, c1)
        ):
            return False
    if config.shared is None:
        return True
    h = config.period_s
    steps = tuple([there - last for there, last in zip(answer, state.command, strict=True)])
    bends = [new - old for new, old in zip(steps, state.increments, strict=True)]
    speeds = tuple([(s + 0.5 * c) / h for s, c in zip(steps, bends, strict=True)])
    on_it = MovingAxes(answer, speeds, tuple([c / (h * h) for c in bends]))
    return _stops_inside(config, on_it, state.command)


def _stops_inside(config: RobotConfig, state: MovingAxes, last: Actuation) -> bool:
    """True when axes that share limits can stop together inside them.

    Args:
        config: of the robot.
        state: of the axes.
        last: command before; where it exceeds a limit, the axes may go on to do so as much.
    """
    shared = config.shared
    if shared is None:
        return True
    own = len(state.position) - config.extra_axes
    most = max(shared.excess(state.position[:own]))
    rates = zip(state.velocity[:own], config.velocity, config.acceleration, config.jerk, strict=False)
    reach = [max(abs(v), _SLOW * top) * (abs(v) / a + 2.0 * a / j) for v, top, a, j in rates]
    if -most > _STEEPEST * sum(reach):
        return True
    allowed = max(*shared.excess(last[:own]), 0.0) + _ROUNDING_M
    if most > allowed:
        return False
    ways = stopping(state, AxisRates(config.velocity, config.acceleration, config.jerk), _LOOKED_AT)
    return all(
        max(shared.excess(way.position[:own])) <= allowed and _within(config, way.position, last)
        for way in ways
    )


def _within(config: RobotConfig, position: Actuation, last: Actuation) -> bool:
    """True when every axis is inside its limits of position, or no further outside than it was."""
    return all(
        min(each.lower, was) - _ROUNDING_M <= at <= max(each.upper, was) + _ROUNDING_M
        for each, at, was in zip(config.limits, position, last, strict=True)
    )


def _viable(config: RobotConfig, index: int, at: float, speed: float, bend: float) -> bool:
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
    if abs(speed + 0.5 * bend * abs(bend) / jolt) > limits.step * _SLACK:
        return False
    if speed < 0.0:
        room, speed, bend = at - limits.lower, -speed, -bend
    else:
        room = limits.upper - at
    return room > speed * (speed / limits.change + limits.change / jolt + 1.0) or (
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


def _pursuing(
    config: RobotConfig, state: RobotState, before: GuardState, changes: Actuation, answer: Actuation
) -> MovingAxes:
    """The state of the axes after this tick on the shortest way to an answer that goes on."""
    h = config.period_s
    rates = AxisRates(config.velocity, config.acceleration, config.jerk)
    now = before.motion
    if now is None or now.position != state.command:
        now = MovingAxes(
            state.command,
            tuple([(s + 0.5 * c) / h for s, c in zip(state.increments, changes, strict=True)]),
            tuple([c / (h * h) for c in changes]),
        )
    pace = [(new - old) / h for new, old in zip(answer, state.reference, strict=True)]
    frame = frame_velocity(pace, rates)
    after: MovingAxes | None = None
    for braking in (False, True):
        for together in (True, False):
            if braking:
                after = braked(now, rates, h, together)
            else:
                after = pursued(now, answer, frame, rates, h, together)
            if after is not None and _stays_viable(config, after, state.command):
                return after
    return after or _coasting(config, now)


def _stays_viable(config: RobotConfig, after: MovingAxes, last: Actuation) -> bool:
    """True for a state of the axes from which they can stop inside every limit."""
    h = config.period_s
    axes = enumerate(zip(*after, strict=True))
    each = all(_viable(config, index, at, v * h, a * h * h) for index, (at, v, a) in axes)
    return each and _stops_inside(config, after, last)


def _coasting(config: RobotConfig, now: MovingAxes) -> MovingAxes:
    """The state after a tick in which accelerations go to zero, where ruckig finds no motion."""
    h = config.period_s
    position, velocity, acceleration = [], [], []
    for at, v, a, most in zip(*now, config.jerk, strict=True):
        jerk = -min(max(a / h, -most), most)
        position.append(at + v * h + a * h * h / 2.0 + jerk * h**3 / 6.0)
        velocity.append(v + a * h + jerk * h * h / 2.0)
        acceleration.append(a + jerk * h)
    return MovingAxes(tuple(position), tuple(velocity), tuple(acceleration))
