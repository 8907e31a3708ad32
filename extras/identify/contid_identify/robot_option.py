"""What the commands share: the option ``--robot`` and the robot of a file that it chooses."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import click

ROBOT: Final = click.option("--robot", "name", help="Which robot, where the file has several.")


def chosen_robot(robot_file: str, names: Iterable[str], name: str | None) -> str:
    """The robot that is meant.

    Args:
        robot_file: as it was given, for messages.
        names: of the robots that have actuators.
        name: from ``--robot``; None where there is one.

    Raises:
        ContidError: no such robot, or several and no name.
    """
    from contid.errors import ContidError

    names = list(names)
    if name is None and len(names) == 1:
        return names[0]
    if name is None:
        raise ContidError(f"{robot_file}: {len(names)} robots ({', '.join(names)}); choose with --robot")
    if name not in names:
        raise ContidError(f"{robot_file}: no robot {name!r}; the file has {', '.join(names)}")
    return name
