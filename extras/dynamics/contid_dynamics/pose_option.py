"""The option ``--at``: a pose by values of axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from contid.robot_file.robot import RobotDescription

POSE: Final = click.option(
    "--at",
    multiple=True,
    metavar="AXIS=VALUE",
    help="An axis of the pose [mm or bar]; others are at rest.",
)


def actuation_at(robot: RobotDescription, name: str, at: tuple[str, ...]) -> list[float]:
    """The actuation [m or Pa] of ``--at``; other axes are at rest.

    Raises:
        click.UsageError: a part is no number of an axis of the robot.
    """
    columns = [f"{axis}_{robot.quantity.unit}" for axis in robot.axis_names]
    actuation = list(robot.rest[: len(columns)])
    for part in at:
        column, _, text = part.partition("=")
        own = column.removeprefix(f"{name}.")
        try:
            value = float(text)
        except ValueError as error:
            raise click.UsageError(
                f"--at {part!r}; allowed: COLUMN=NUMBER, such as {columns[0]}=1"
            ) from error
        if own not in columns:
            raise click.UsageError(f"--at {part!r}: no such axis; allowed: {', '.join(columns)}")
        actuation[columns.index(own)] = robot.quantity.to_si(value)
    return actuation
