"""The next command of a robot under every limit: of its axes, of its path and of its tensions."""

from __future__ import annotations

from collections.abc import Sequence

from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import limit
from contid.control.tick.on_path import limit_on_path
from contid.control.tick.shared_limits import limit_shared
from contid.control.tick.taut import limit_taut
from contid.targets import Actuation, Target


def next_command(
    config: RobotConfig,
    last: Actuation,
    last_steps: Actuation,
    reference: Actuation,
    reference_steps: Sequence[float],
    target_in_base: Target | None = None,
    straight: bool = False,
) -> tuple[Actuation, tuple[int, ...], bool]:
    """Next command of every axis, per axis the limits that bound, and ``straight``.

    Args:
        config: of the robot.
        last: the last command.
        last_steps: the last command minus the one before.
        reference: where the axes have to go.
        reference_steps: how far it moved in this tick.
        target_in_base: what the reference answers; None for a motion of the axes.
        straight: the axes go on a straight line to the reference (`contid.control.tick.way`).
    """
    if target_in_base is None:
        command, flags = limit(config.limits, last, last_steps, reference, reference_steps)
        straight = False
    else:
        command, flags, straight = limit_on_path(
            config, last, last_steps, reference, reference_steps, target_in_base, straight
        )
    own = len(command) - config.extra_axes
    if config.shared is not None:
        kept, bound = limit_shared(
            config.shared, config.limits[:own], last[:own], last_steps[:own], (command[:own], flags[:own])
        )
        return (*kept, *command[own:]), (*bound, *flags[own:]), straight
    if config.taut is None:
        return command, flags, straight
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
