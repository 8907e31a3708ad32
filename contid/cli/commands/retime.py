"""``contid retime``: the fastest timing of a trajectory."""

from __future__ import annotations

import sys
from typing import TextIO

import click

from contid.cli.support.robot_names import robot_names


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.argument("trajectory", type=click.Path(dir_okay=False, exists=True, allow_dash=True))
def command(robot_file: str, trajectory: str) -> None:
    """Print TRAJECTORY (`-`: stdin) with the fastest timing for ROBOT_FILE, one row per tick.

    The path stays; its times are replaced, dwells are left out. Velocity, acceleration and jerk of every axis
    hold at every tick. Needs the extra `retime`.
    """
    print_fastest(robot_file, trajectory)


def print_fastest(robot_file: str, trajectory: str, text: TextIO | None = None) -> None:
    """Print the fastest timing of a file, or of ``text`` by that name."""
    from contid.control.daemon.check_trajectory import fastest_trajectory
    from contid.trajectory.table import write_rows

    found = fastest_trajectory(robot_file, trajectory, text)
    write_rows(sys.stdout, found.columns, found.rows.tolist())
    click.echo(
        f"contid: {found.duration_s:.4g} s; velocity, acceleration and jerk hold, {found.binding} binds",
        err=True,
    )
