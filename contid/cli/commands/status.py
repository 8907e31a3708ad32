"""``contid status``: state of a running daemon and its robots."""

from __future__ import annotations

import json
import sys

import click

from contid.cli.support.numbers import NumberRange
from contid.cli.support.orders import json_option, socket_option


@click.command()
@click.option("--watch", is_flag=True, help="Repeat until Ctrl-C; finds the daemon again after it ended.")
@click.option(
    "--rate", type=NumberRange(0.2, 20.0), default=5.0, show_default=True, help="Updates per second."
)
@socket_option
@json_option
def command(watch: bool, rate: float, socket: str | None, as_json: bool) -> None:
    """Show robots, buses and faults of a running daemon; exit code 3 in FAULT or when nothing ticks.

    With --watch and --json: one line per update.
    """
    from rich.console import Console

    from contid.cli.support.render_status import render_status, watch_status
    from contid.client import Client

    if watch:
        watch_status(socket, rate, as_json)
        return
    with Client(socket, name="contid status") as client:
        status = client.status()
    if as_json:
        click.echo(json.dumps(status))
    else:
        Console().print(render_status(status))
    faults = (robot["fault"] for robot in status["robots"].values() if "fault" in robot)
    if any(faults) or status.get("stalled"):
        sys.exit(3)
