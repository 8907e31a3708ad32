"""Velocity, acceleration and jerk of every axis hold in every tick of a live stream, whatever its targets do.

The answer of the model to a target is commanded as it is where the axes can be on it in this tick and go on
with it, within the limits of the robot file. Where they cannot - a row that jumps, a path that is too fast, a
robot that has to catch up - all axes go to it together by the shortest motion within these limits
(`contid.trajectory.pursuit`), until they can be on it again. What is tried in which order is compiled:
``contid/kernels/limiter/catch_up.hpp``.

Everything is judged by differences of commands, one period h apart: the step s, its change c and the change u
of that, bounded by ``v h``, ``a h^2`` and ``j h^3``. The parabola through the last three commands has the
velocity ``s + c/2`` and the acceleration c at the last one; a motion that begins there with a jerk within j
has third differences within ``j h^3`` from its first sample on.
"""

from __future__ import annotations

from contid.control.tick.config import RobotConfig
from contid.control.tick.state import GuardState, RobotState
from contid.records import record
from contid.targets import Actuation
from contid.trajectory.pursuit import MovingAxes


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
    paces, motion, brakes, flags = config.guard.guarded(
        answer, state.command, state.increments, last_steps, state.reference, before.paces, before.motion,
        before.brakes,
    )  # fmt: skip
    if motion is None:
        return Guarded(answer, GuardState(state.since_s, paces, None))
    after = MovingAxes(*motion)
    return Guarded(after.position, GuardState(state.since_s, paces, after, brakes), flags)
