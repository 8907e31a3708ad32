"""``contid jog``: a robot moved by the keys of a terminal."""

from __future__ import annotations

import sys

import click

from contid.cli.support.numbers import NumberRange
from contid.cli.support.orders import socket_option


@click.command()
@click.argument("robot", required=False)
@click.option("--axes", is_flag=True, help="Begin with the axes instead of the tip.")
@click.option("--speed", type=NumberRange(0.01, 1000.0), help="First speed of the tip [mm/s]; default 10.")
@click.option(
    "--hold-ms",
    default=150.0,
    show_default=True,
    type=NumberRange(20.0, 1000.0),
    help="One key press moves so long; without another the robot holds.",
)
@click.option("--takeover", is_flag=True, help="Take the lease from its holder; the robots hold.")
@socket_option
def command(
    robot: str | None, axes: bool, speed: float | None, hold_ms: float, takeover: bool, socket: str | None
) -> None:
    """Move ROBOT of a running daemon by the arrow keys or WASD; space stops, q quits.

    A key that is held repeats and moves steadily; released, the robot holds after --hold-ms. Tab changes
    between tip and axes, 1 to 9 choose an axis, + and - change the speed.
    """
    from contid.client import Client
    from contid.teleop.jog_session import HELP, JogSession
    from contid.teleop.keys import Keyboard
    from contid.teleop.status_line import StatusLine

    line = StatusLine(sys.stdout)
    with Client(socket, name="contid jog") as client, line, Keyboard() as keyboard:
        session = JogSession(
            client, robot, keyboard, line.log, line.show, hold_s=hold_ms / 1e3, speed=speed, axes=axes
        )
        line.log(HELP)
        session.run(takeover)
