"""Options and the run that `contid track natnet` and `contid track vicon` share."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from ipaddress import AddressValueError, IPv4Address
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from contid.cli.support.orders import socket_option
from contid.cli.support.parameters import NumberRange

if TYPE_CHECKING:
    from contid_mocap.room import RoomStream
    from contid_mocap.setup_file import MocapSetup
    from contid_mocap.tip_tracker import RoomTip

    _Address = click.ParamType[IPv4Address]
else:  # older releases of click have no type of its value
    _Address = click.ParamType

_Command = TypeVar("_Command", bound=Callable[..., None])


class AddressType(_Address):
    """An IPv4 address, as numbers: what is listened to must not depend on a name server."""

    name = "address"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> IPv4Address:
        """The address."""
        try:
            return IPv4Address(value)
        except AddressValueError:
            self.fail(f"{value!r} is no IPv4 address, such as 192.168.1.5.", param, ctx)


ADDRESS = AddressType()


def room_options(command: _Command) -> _Command:
    """The options of every room."""
    options = [
        click.argument("robot", required=False),
        click.option("--server", type=ADDRESS, required=True, help="Address of the motion-capture computer."),
        click.option(
            "--local", type=ADDRESS, required=True, help="Address of this computer that it sends to."
        ),
        click.option(
            "--setup",
            default="mocap.yaml",
            show_default=True,
            type=click.Path(path_type=Path, dir_okay=False),
            help="Where the room is, and what in it is a tip.",
        ),
        click.option("--list", "listing", is_flag=True, help="Print what can be named; needs no setup."),
        click.option("--print", "printing", is_flag=True, help="Print rows as CSV; needs no daemon."),
        click.option("--for", "seconds", type=NumberRange(min=0.1), help="End after this time [s]."),
        socket_option,
    ]
    for option in reversed(options):
        command = option(command)
    return command


def list_names(stream: RoomStream, seconds: float | None) -> None:
    """Print bodies and markers with their newest positions in the room, after a second of frames."""
    import time

    from contid_mocap.room import RoomPose

    newest: dict[str, RoomPose | None] = {}
    end_s = time.monotonic() + (seconds or 1.0)
    while time.monotonic() < end_s:
        for frame in stream.poll(0.1):
            newest.update(frame.poses)
    named = stream.names()
    for name in [*named, *sorted(newest.keys() - set(named))]:
        pose = newest.get(name)
        kind = "marker" if ":" in name else "body"
        place = "not tracked"
        if pose is not None:
            place = "x_mm {:.1f}, y_mm {:.1f}, z_mm {:.1f}".format(
                *(1e3 * value for value in pose.position_m)
            )
        click.echo(f"{kind} {name!r}: {place}")
    if not newest:
        click.echo("contid: no frame has arrived", err=True)
        sys.exit(1)


def run_room(
    stream: RoomStream,
    setup: MocapSetup,
    robot: str | None,
    printing: bool,
    seconds: float | None,
    socket: str | None,
) -> None:
    """Track until the end; a report follows on stderr."""
    from contid_mocap.follow import HEADER, Follower, FollowReport, follow, row
    from contid_mocap.tip_tracker import RoomTipTracker

    report = FollowReport()

    def notify(line: str) -> None:
        click.echo(f"contid: {line}", err=True)

    try:
        tracker = RoomTipTracker(setup, [robot] if robot else [])
        if printing:
            click.echo(HEADER)

            def print_rows(tips: Sequence[RoomTip]) -> None:
                click.echo("\n".join(row(tip) for tip in tips))

            follow(stream, tracker, Follower(print_rows, notify), report, seconds)
        else:
            from contid.client import Client
            from contid.control.process.realtime import TRACKER, request_real_time
            from contid_mocap.sending import RoomTipSender

            request_real_time(TRACKER)
            with Client(socket, name="contid track") as client:
                follow(
                    stream,
                    tracker,
                    Follower(RoomTipSender(client, notify), notify, newest=True),
                    report,
                    seconds,
                )
    finally:
        stream.close()
        click.echo(str(report), err=True)
    if report.measured == 0:
        sys.exit(1)
