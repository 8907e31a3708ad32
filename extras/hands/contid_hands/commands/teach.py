"""``contid teach``: poses and motions of robots that are moved by hand."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from contid.cli.support.orders import socket_option
from contid.cli.support.parameters import NewFile, NumberRange


@click.command()
@click.argument("robots", nargs=-1)
@click.option(
    "-o",
    "--output",
    type=NewFile(path_type=Path, dir_okay=False),
    help="Pose file; default ROBOTFILE.poses.yaml beside the robot file of the daemon.",
)
@click.option("--grip", type=NumberRange(0.0, 1.0), help="Stay armed with this share of the current.")
@click.option("--keep", is_flag=True, help="Leave torque and current as they are; save where robots stand.")
@click.option(
    "--rows-hz",
    default=20.0,
    show_default=True,
    type=NumberRange(1.0, 100.0),
    help="Rows per second of recorded motions.",
)
@click.option("--takeover", is_flag=True, help="Take the lease from its holder; the robots hold.")
@click.option("--yes", is_flag=True, help="Do not ask before the torque is switched off.")
@socket_option
def command(
    robots: tuple[str, ...],
    output: Path | None,
    grip: float | None,
    keep: bool,
    rows_hz: float,
    takeover: bool,
    yes: bool,
    socket: str | None,
) -> None:
    """Switch the torque of ROBOTS of a running daemon off (default: all); save poses and motions by keys.

    Keys: s saves the pose under a name, r begins and ends the recording of a motion, q ends. Recordings are
    smoothed and written beside the pose file as trajectories. Pneumatic arms keep their pressures, which are
    saved. `contid resume` arms the robots again, where they stand.
    """
    from contid.client import Client
    from contid_hands.teach.session import TeachSession
    from contid_hands.teach.teacher import HELP
    from contid_hands.teleop.keys import Keyboard
    from contid_hands.teleop.status_line import StatusLine

    if grip is not None and keep:
        raise click.UsageError("--grip and --keep exclude each other")
    line = StatusLine(sys.stdout)
    with Client(socket, name="contid teach") as client:
        session = TeachSession(client, robots, output, rows_hz, line.log)
        relaxes = session.relaxed if grip is None and not keep else ()
        if relaxes and not yes:
            names = ", ".join(relaxes)
            click.confirm(f"{names}: the torque goes off. Support what can fall. Continue?", abort=True)
        session.prepare(takeover, grip, keep)
        line.log(f"poses go to {session.file}. Keys: {HELP}")
        with line, Keyboard() as keyboard:
            session.run(keyboard, line.show)
    if relaxes:
        click.echo("contid resume arms the robots where they stand")
