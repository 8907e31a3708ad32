"""One order to a daemon (``contid hold``, ``resume``, ``recover``, ``stop``, ``estop``), and its status."""

from __future__ import annotations

import json
import sys

import click

from contid.cli.support.orders import json_option, order, send, socket_option
from contid.cli.support.parameters import NumberRange

hold = order("hold", "Stop with limited jerk and stay. Needs no lease.")
resume = order(
    "resume",
    "Arm and continue with what was followed, also after a stop. After FAULT use clear-fault first.",
    after_stop=True,
)
estop = order("estop", "Relax or vent at once, by stop.estop of the robot file. Needs no lease.")
recover = order(
    "recover",
    "Move robots found outside their limits (fault 109) inside, slowly, and hold.",
    after_stop=True,
)
clear_fault = order(
    "clear_fault",
    "Clear the devices' faults, re-check all devices and leave FAULT. Never moves; resume arms.",
)


@click.command()
@click.argument("robots", nargs=-1)
@click.option("--end", is_flag=True, help="End the daemon too, as the first Ctrl-C does.")
@socket_option
@json_option
def stop(robots: tuple[str, ...], end: bool, socket: str | None, as_json: bool) -> None:
    """Stop robots by stop.on_interrupt of the robot file. Needs no lease.

    ROBOTS: names in the robot file; default all.
    """
    send(socket, as_json, lambda client: client.stop(robots or None, end=end), persistent=not end)


@click.command()
@click.option("--watch", is_flag=True, help="Repeat until Ctrl-C; finds the daemon again after it ended.")
@click.option(
    "--rate", type=NumberRange(0.2, 20.0), default=5.0, show_default=True, help="Updates per second."
)
@socket_option
@json_option
def status(watch: bool, rate: float, socket: str | None, as_json: bool) -> None:
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
        reported = client.status()
    if as_json:
        click.echo(json.dumps(reported))
    else:
        Console().print(render_status(reported))
    faults = (robot["fault"] for robot in reported["robots"].values() if "fault" in robot)
    if any(faults) or reported.get("stalled"):
        sys.exit(3)
