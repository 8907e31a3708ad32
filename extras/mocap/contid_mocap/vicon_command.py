"""``contid track vicon``: objects of a Vicon room as trackers of tips."""

from __future__ import annotations

from ipaddress import IPv4Address
from pathlib import Path

import click

from contid_mocap.options import list_names, room_options, run_room


@click.command()
@room_options
@click.option(
    "--port",
    type=click.IntRange(1, 65535),
    default=51001,
    show_default=True,
    help="That the server sends to.",
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
    port: int,
) -> None:
    """Measure tips with a Vicon room (UDP object stream) and send them to the running daemon.

    ROBOT is one of the setup; without it all of them are tracked. --list prints the names of objects.
    --local is 0.0.0.0 where Tracker sends to a broadcast address. Ctrl-C ends; a report follows on stderr.
    """
    from contid.errors import ContidError
    from contid_mocap.setup_file import read_setup
    from contid_mocap.vicon.stream import ViconSource, ViconStream

    if listing:
        list_names(ViconStream(ViconSource(server, local, port)), seconds)
        return
    loaded = read_setup(setup)
    for name, place in loaded.robots.items():
        if place.marker is not None:
            raise ContidError(f"{setup}: {name}: Vicon's UDP object stream has no markers; give `body`")
    facts = loaded.vicon
    source = ViconSource(server, local, port, facts.rate_hz, facts.latency_ms / 1e3, facts.fixed_axes)
    run_room(ViconStream(source), loaded, robot, printing, seconds, socket)
