"""``contid play``: a sequence of named poses."""

from __future__ import annotations

from pathlib import Path

import click

from contid.cli.support.orders import socket_option


@click.command()
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("poses", nargs=-1)
@click.option("--repeat", default=1, type=click.IntRange(0), help="How many times; 0: until Ctrl-C.")
@click.option("--takeover", is_flag=True, help="Take the lease from its holder; the robots hold.")
@socket_option
def command(file: Path, poses: tuple[str, ...], repeat: int, takeover: bool, socket: str | None) -> None:
    """Play the sequence of a pose FILE on a running daemon, or POSES one after the other.

    Names, columns and limits of the axes are compared with the robots before anything moves; the daemon
    checks each step as `contid move` does. Ctrl-C holds.
    """
    from contid.client import Client
    from contid_hands.teach.play import Player
    from contid_hands.teach.pose_file import read_pose_file

    read = read_pose_file(file)
    with Client(socket, name="contid play") as client:
        player = Player(client, read, poses, click.echo)
        if takeover:
            client.acquire(takeover=True)
        player.play(repeat)
