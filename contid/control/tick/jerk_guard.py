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

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from contid.control.tick.axis_motions import PresentRates
from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import ACCELERATION
from contid.control.tick.state import GuardState, RobotState
from contid.records import record
from contid.targets import Actuation
from contid.trajectory.approach import optimal
from contid.trajectory.planned_motion import AxisRates, Lines, MovingAxes
from contid.trajectory.pursuit import braked, frame_velocity, kept_line, pursued

#: Shares of the velocity with which a tendon robot goes on before it stops, where its way leaves limits.
_SHARES: Final = (1.0, 0.3, 0.1)


@record(frozen=True, slots=True)
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


class _Pursuit(NamedTuple):
    """The state of the axes after a tick, and whether a tendon robot stops before it goes on."""

    after: MovingAxes
    brakes: bool = False


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
    # Every axis may be on its answer in this tick, and on it if it goes on in the two next.
    on, paces = config.guard.on(
        answer, state.command, state.increments, last_steps, state.reference, before.paces
    )
    # By motion rules 0 the limiter of tendons alone keeps their limits, without that of jerk.
    if on or not optimal() or (config.taut is not None and config.motion_rules == 0):
        return Guarded(answer, GuardState(state.since_s, paces, None))
    changes = tuple([s - was for s, was in zip(state.increments, last_steps, strict=True)])
    motion, brakes = _pursuing(config, state, before, changes, answer)
    if config.motion_rules > 1:
        motion = _inside(config, motion, state.command)
    flags = tuple(
        [ACCELERATION if new != there else 0 for new, there in zip(motion.position, answer, strict=True)]
    )
    after = GuardState(state.since_s, paces, motion, brakes)
    return Guarded(motion.position, after, flags)


def _inside(config: RobotConfig, motion: MovingAxes, last: Actuation) -> MovingAxes:
    """The state with positions that rounding has put beyond a limit put on it.

    The limiter would brake all axes by their whole acceleration for one that is 1e-6 Pa too far.
    """
    limits = zip(motion.position, config.limits, last, strict=True)
    inside = tuple([max(min(at, max(one.upper, was)), min(one.lower, was)) for at, one, was in limits])
    return motion if inside == motion.position else motion._replace(position=inside)


def _pursuing(
    config: RobotConfig, state: RobotState, before: GuardState, changes: Actuation, answer: Actuation
) -> _Pursuit:
    """The state of the axes after this tick on the shortest way to an answer that goes on."""
    h = config.period_s
    rates = AxisRates(config.velocity, config.acceleration, config.jerk)
    now = before.motion
    if now is None or now.position != state.command:
        now = MovingAxes(state.command, *PresentRates.at_end(state.increments, changes, h))
    pace = [(new - old) / h for new, old in zip(answer, state.reference, strict=True)]
    if config.taut is not None:
        stops = before.brakes and (any(now.velocity) or any(now.acceleration))
        return _tendons_pursuing(config, state.command, now, answer, pace, () if stops else _SHARES)
    frame = frame_velocity(pace, rates)
    after: MovingAxes | None = None
    for after in _ways(now, answer, frame, rates, h, Lines.of(config.motion_rules)):
        if after is not None and config.guard.stays_viable(after, state.command):
            return _Pursuit(after)
    return _Pursuit(after or _coasting(config, now))


def _ways(
    now: MovingAxes, answer: Actuation, frame: Actuation, rates: AxisRates, h: float, straight: Lines
) -> Iterator[MovingAxes | None]:
    """States after a tick on ways to an answer, in the order in which they are tried; the last ones stop."""
    yield pursued(now, answer, frame, rates, h, straight=straight)
    yield pursued(now, answer, frame, rates, h, False, straight=straight)
    if straight:
        yield kept_line(now, answer, rates, h, straight)
    yield braked(now, rates, h, True, straight)
    yield braked(now, rates, h, False)


def _tendons_pursuing(
    config: RobotConfig,
    last: Actuation,
    now: MovingAxes,
    answer: Actuation,
    pace: Sequence[float],
    shares: Sequence[float],
) -> _Pursuit:
    """As `_pursuing` for tendons, whose answers lie close to their limits.

    From rest the way to an answer is a straight line of the pulls, in which the limits are convex. In motion
    it may lead out of them: then the robot goes on more slowly, or stops before it sets out again. ``shares``
    of the velocity are tried one after the other; without any it stops.
    """
    h, rates = config.period_s, AxisRates(config.velocity, config.acceleration, config.jerk)
    straight = Lines.of(config.motion_rules)
    for share in shares:
        slower = rates._replace(velocity=[share * each for each in rates.velocity])
        after = pursued(now, answer, frame_velocity(pace, slower), slower, h, straight=straight)
        if after is not None and config.guard.stays_viable(after, last):
            return _Pursuit(after)
    stop = braked(now, rates, h, together=True, straight=straight)
    return _Pursuit(stop or _coasting(config, now), brakes=True)


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
