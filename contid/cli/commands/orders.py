"""``contid hold``, ``resume``, ``recover``, ``stop``, ``estop``, ``clear-fault``: one order to a daemon."""

from __future__ import annotations

import click

from contid.cli.support.orders import json_option, order, send, socket_option

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
