"""``contid track natnet``: bodies and markers of an OptiTrack room as trackers of tips."""

from __future__ import annotations

from ipaddress import IPv4Address
from pathlib import Path

import click

from contid_mocap.options import ADDRESS, list_names, room_options, run_room

_VERSIONS = ("3.0", "3.1", "4.0", "4.1")


@click.command()
@room_options
@click.option(
    "--multicast", type=ADDRESS, help="Group that the server sends to; without it to this computer alone."
)
@click.option(
    "--command-port", type=click.IntRange(1, 65535), default=1510, show_default=True, help="Of the server."
)
@click.option(
    "--data-port", type=click.IntRange(1, 65535), help="Of the group; default: what the server states."
)
@click.option(
    "--version", type=click.Choice(_VERSIONS), help="Of the frames; default: the newest that both have."
)
def command(
    robot: str | None,
    server: IPv4Address,
    local: IPv4Address,
    setup: Path,
    listing: bool,
    printing: bool,
    seconds: float | None,
    socket: str | None,
    multicast: IPv4Address | None,
    command_port: int,
    data_port: int | None,
    version: str | None,
) -> None:
    """Measure tips with an OptiTrack room (NatNet 3.0 to 4.1) and send them to the running daemon.

    ROBOT is one of the setup; without it all of them are tracked. --list prints the names of bodies and
    markers. Ctrl-C ends; a report follows on stderr.
    """
    from contid_mocap.natnet.stream import NatNetAddresses, NatNetStream
    from contid_mocap.setup_file import read_setup

    if multicast is not None and not multicast.is_multicast:
        raise click.BadParameter(f"{multicast} is no multicast group (224.0.0.0 to 239.255.255.255)")
    major, _, minor = (version or "0.0").partition(".")
    chosen = (int(major), int(minor)) if version else None
    addresses = NatNetAddresses(server, local, command_port, multicast, data_port, chosen)
    loaded = None if listing else read_setup(setup)
    stream = NatNetStream(addresses)
    if loaded is None:
        list_names(stream, seconds)
    else:
        run_room(stream, loaded, robot, printing, seconds, socket)
