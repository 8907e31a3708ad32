"""What the commands share: robots with a moving body, and the option ``--at``, a pose by values of axes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from collections.abc import Collection

    from contid.robot_file.robot import RobotDescription

POSE: Final = click.option(
    "--at",
    multiple=True,
    metavar="AXIS=VALUE",
    help="An axis of the pose [mm or bar]; others are at rest.",
)


def moving_robots(robot_file: str) -> dict[str, RobotDescription]:
    """The robots of a file whose body moves, by name.

    Raises:
        ContidError: the file cannot be loaded, or none of its robots has ``dynamics``.
    """
    from contid.errors import ContidError
    from contid.robot_file.load import load_named

    robots = load_named(robot_file).driven
    moving = {name: each for name, each in robots.items() if getattr(each, "dynamics", None) is not None}
    if not moving:
        raise ContidError(
            f"{robot_file}: no robot has 'dynamics'; the body in motion needs mass_g_per_m and damping_ms "
            "(docs/robots/dynamics.md)"
        )
    return moving


def actuation_at(
    robot: RobotDescription, name: str, at: tuple[str, ...], others: Collection[str] = ()
) -> list[float]:
    """The actuation [m or Pa] of ``--at``; other axes are at rest.

    Args:
        robot: of the file.
        name: of the robot.
        at: the parts of the option.
        others: names of further robots; ``NAME.AXIS`` of one of them is none of this robot.

    Raises:
        click.UsageError: a part is no number of an axis of the robot.
    """
    columns = [f"{axis}_{robot.quantity.unit}" for axis in robot.axis_names]
    actuation = list(robot.rest[: len(columns)])
    for part in at:
        column, _, text = part.partition("=")
        if column.partition(".")[0] in others and column not in columns:
            continue
        own = column.removeprefix(f"{name}.")
        try:
            value = float(text)
            if not math.isfinite(value):
                raise ValueError(text)
        except ValueError as error:
            raise click.UsageError(
                f"--at {part!r}; allowed: COLUMN=NUMBER, such as {columns[0]}=1"
            ) from error
        if own not in columns:
            raise click.UsageError(f"--at {part!r}: no such axis; allowed: {', '.join(columns)}")
        actuation[columns.index(own)] = robot.quantity.to_si(value)
    return actuation
