"""What ``contid modes`` and ``contid export`` share: robots with a moving body, and ``--at``, a pose."""

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
    metavar="COLUMN=NUMBER",
    help="An axis of the pose with its unit, such as s1.p1_bar=0.6; others are at rest.",
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
        click.UsageError: a part is no number of an axis of the robot, is outside its limits, or repeats it.
    """
    columns = [f"{axis}_{robot.quantity.unit}" for axis in robot.axis_names]
    actuation, given = list(robot.rest[: len(columns)]), set[int]()
    for part in at:
        column, _, text = part.partition("=")
        if column.partition(".")[0] in others and column not in columns:
            continue
        own = column if column in columns else column.removeprefix(f"{name}.")
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
        number = columns.index(own)
        if number in given:
            raise click.UsageError(f"--at {part!r}: the axis was given before; each axis once")
        given.add(number)
        low, high = (robot.quantity.from_si(limits[number]) for limits in (robot.lower, robot.upper))
        if not low <= value <= high:
            raise click.UsageError(f"--at {part!r}: outside the limits of the axis, {low:g} to {high:g}")
        actuation[number] = robot.quantity.to_si(value)
    return actuation
