"""``contid stop``: stop by policy, and end the daemon if asked to."""

from __future__ import annotations

import click

from contid.cli.support.orders import json_option, socket_option, told


@click.command()
@click.argument("robots", nargs=-1)
@click.option("--end", is_flag=True, help="End the daemon too, as the first Ctrl-C does.")
@socket_option
@json_option
def command(robots: tuple[str, ...], end: bool, socket: str | None, as_json: bool) -> None:
    """Stop robots by the robot file's stop.on_interrupt. Anybody may, whoever moves the robots.

    ROBOTS: names in the robot file; default all.
    """
    told(socket, as_json, lambda client: client.stop(robots or None, end=end))
