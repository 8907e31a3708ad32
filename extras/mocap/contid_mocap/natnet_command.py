"""``contid track natnet``: bodies and markers of an OptiTrack room as trackers of tips."""

from __future__ import annotations

from ipaddress import IPv4Address
from pathlib import Path
from typing import Final

import click

from contid_mocap.natnet.messages import COMMAND_PORT, VERSIONS
from contid_mocap.options import ADDRESS, list_names, room_options, run_room

#: Versions by their names.
NATNET_VERSIONS: Final = {f"{major}.{minor}": (major, minor) for major, minor in VERSIONS}


@click.command()
@room_options
@click.option(
    "--multicast", type=ADDRESS, help="Group that the server sends to; without it to this computer alone."
)
@click.option(
    "--command-port",
    type=click.IntRange(1, 65535),
    default=COMMAND_PORT,
    show_default=True,
    help="Of the server.",
)
@click.option(
    "--data-port", type=click.IntRange(1, 65535), help="Of the group; default: what the server states."
)
@click.option(
    "--version",
    type=click.Choice(list(NATNET_VERSIONS)),
    help="Of the frames; default: the newest that both have.",
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
    chosen = None if version is None else NATNET_VERSIONS[version]
    addresses = NatNetAddresses(server, local, command_port, multicast, data_port, chosen)
    loaded = None if listing else read_setup(setup)
    stream = NatNetStream(addresses)
    if loaded is None:
        list_names(stream, seconds)
    else:
        run_room(stream, loaded, robot, printing, seconds, socket)
