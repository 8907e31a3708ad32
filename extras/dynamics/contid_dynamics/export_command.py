"""``contid export mjcf``: a robot as a model for MuJoCo."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import click

from contid.cli.support.parameters import robot_names
from contid.cli.support.table import TableGroup
from contid_dynamics.pose_option import POSE, actuation_at, moving_robots

COMMANDS: Final = {"mjcf": ("contid_dynamics.export_command:mjcf", "a robot as a model for MuJoCo")}
command = TableGroup(
    COMMANDS, "Formats", "export", name="export", help="A robot as a model for other simulators."
)


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@POSE
@click.option("--robot", "name", help="Which robot of the file; needed where several have a moving body.")
@click.option(
    "--elements", type=click.IntRange(2, 64), default=16, show_default=True, help="Links of a section."
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False, allow_dash=True),
    help="File to write; stdout without, and for `-`.",
)
def mjcf(robot_file: str, at: tuple[str, ...], name: str | None, elements: int, output: Path | None) -> None:
    """A robot of ROBOT_FILE with `dynamics` as an MJCF model: links, joints, tendons and actuators.

    Controls are pulls in m or pressures in bar. The stiffness of a pneumatic arm is that at the pressures of
    --at, which are also those of the key frame.

    `contid export mjcf tendon3 --at s1.t1_mm=5 -o tendon3.xml`
    """
    from contid.errors import ContidError
    from contid.whole_file import replacing
    from contid_dynamics.mjcf import mjcf as document

    moving = moving_robots(robot_file)
    if name is not None and name not in moving:
        allowed = ", ".join(moving)
        raise click.UsageError(f"--robot {name!r}: no robot with dynamics of that name; allowed: {allowed}")
    if name is None and len(moving) > 1:
        raise click.UsageError(f"several robots have a moving body: give --robot, one of {', '.join(moving)}")
    chosen = name or next(iter(moving))
    try:
        text = document(moving[chosen], chosen, actuation_at(moving[chosen], chosen, at), elements)
    except ArithmeticError as error:
        raise ContidError(f"{chosen}: no equilibrium at --at: the tendons pull against each other") from error
    if output in (None, Path("-")):
        click.echo(text, nl=False)
    else:
        with replacing(output) as file:
            file.write(text.encode())
