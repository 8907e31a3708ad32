"""The next command of a robot under every limit: of its axes, of its path and of its tensions.

While a robot follows a target the limits of its axes keep the tip on it: redundant motion waits instead.

A redundant arm moves its axes in two parts: what its tip needs, and what brings the axes to the preferred of
all solutions. Where a limit binds, the second part is scaled by one share for all axes, the greatest from
which they can brake together; the first stays whole. Axes that are at their bound of this tick stop
there and the others take their part, after F. Flacco, A. De Luca, O. Khatib, "Control of Redundant Robots
Under Hard Joint Constraints: Saturation in the Null Space", IEEE Trans. Robotics 31(3), 2015.

Where no command within the limits has its tip on target (a jump, a path that is too fast), all axes go by one
share along a straight line to it (`contid.control.tick.ways.chord`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import allowed_steps
from contid.control.tick.shared_limits import limit_shared
from contid.control.tick.taut import keeps_tensions, limit_taut
from contid.control.tick.ways.joint_steps import within
from contid.control.tick.ways.way import Way
from contid.robot_file.base import Quantity
from contid.targets import Actuation, Target

#: A command is on its target when its tip is no farther off than this [m]: by rounding for racks and tubes,
#: by the error of the statics for rods.
_TOLERANCE_M: Final = {Quantity.LENGTH: 1e-9, Quantity.PRESSURE: 5e-5}
#: Error of a command that is on target, as a share of the tolerance.
_EXACT: Final = 1e-3


def tip_tolerance_m(quantity: Quantity) -> float:
    """Greatest distance of the commanded tip from its target on a path that is followed [m]."""
    return _TOLERANCE_M[quantity]


def next_command(
    config: RobotConfig,
    last: Actuation,
    last_steps: Actuation,
    reference: Actuation,
    reference_steps: Sequence[float],
    target_in_base: Target | None = None,
    straight: bool = False,
    keeps_jerk: bool = False,
) -> tuple[Actuation, tuple[int, ...], bool]:
    """Next command of every axis, per axis the limits that bound, and ``straight``.

    Args:
        config: of the robot.
        last: the last command.
        last_steps: the last command minus the one before.
        reference: where the axes have to go.
        reference_steps: how far it moved in this tick.
        target_in_base: what the reference answers; None for a motion of the axes.
        straight: the axes are on a straight line to the reference, because the tip cannot be
            (`contid.control.tick.ways.way`).
        keeps_jerk: the reference is that of `contid.control.tick.jerk_guard`, from which the axes can stop.
    """
    if reference == last and not any(last_steps) and not any(reference_steps):
        # They stand where they have to be: every limit held when the last command was made.
        return last, (0,) * len(last), straight and target_in_base is not None
    if target_in_base is None:
        command, flags = config.guard.limit(last, last_steps, reference, reference_steps)
        straight = False
    else:
        command, flags, straight = limit_on_path(
            config, last, last_steps, reference, reference_steps, target_in_base, straight
        )
    own = len(command) - config.extra_axes
    if config.shared is not None:
        if config.guard.stays_clear(last, command):  # the usual case
            return command, flags, straight
        kept, bound = limit_shared(
            config.shared, config.limits[:own], last[:own], last_steps[:own], (command[:own], flags[:own])
        )
        return (*kept, *command[own:]), (*bound, *flags[own:]), straight
    if config.taut is None:
        return command, flags, straight
    if keeps_jerk and keeps_tensions(config.taut, command[:own], last[:own]):
        return command, flags, False
    tendons, bound = limit_taut(
        config.taut,
        config.limits[:own],
        last[:own],
        last_steps[:own],
        reference[:own],
        reference_steps[:own],
        (command[:own], flags[:own]),
    )
    return (*tendons, *command[own:]), (*bound, *flags[own:]), False


def limit_on_path(
    config: RobotConfig,
    last: Actuation,
    last_steps: Actuation,
    answer: Actuation,
    answer_steps: Sequence[float],
    target_in_base: Target,
    straight: bool = False,
) -> tuple[Actuation, tuple[int, ...], bool]:
    """`next_command` of a robot that follows targets, before the limits that its axes share."""
    command, flags = config.guard.limit(last, last_steps, answer, answer_steps)
    own = len(command) - config.extra_axes
    if command[:own] == answer[:own] or not all(map(math.isfinite, answer)):
        return command, flags, False
    limits = config.limits[:own]
    steps = [allowed_steps(each, *at) for each, *at in zip(limits, last, last_steps, strict=False)]
    low, high = (np.array(side) for side in zip(*steps, strict=True))
    way = Way(config, last[:own], answer[:own], answer_steps[:own], target_in_base, command[own:], low, high)
    exact_m = _EXACT * _TOLERANCE_M[config.quantity]
    held = way.held(np.array(command[:own]), exact_m)
    if held is None and config.taut is None and within(config, last[:own], command[own:]):
        onward = way.towards(np.array(last_steps[:own]), straight)
        if onward is not None:
            held, straight = onward
    # Outside the limits each axis goes inwards by itself; tendons have a limiter of their own.
    if held is None:
        return command, flags, False
    return (*held.tolist(), *command[own:]), flags, straight
