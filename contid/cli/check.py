"""``contid check``."""

from __future__ import annotations

import click


@click.command()
@click.argument("robot_file", type=click.Path(exists=True, dir_okay=False))
def command(robot_file: str) -> None:
    """Validate ROBOT_FILE and print what it describes."""
    raise click.ClickException("not there yet")
