"""``contid track``: a camera as the tracker of a tip."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from contid.cli.support.orders import socket_option
from contid.cli.support.parameters import NewFile


@click.command()
@click.argument("robot", required=False)
@click.option("--camera", help="Number of a camera, or a video file.")
@click.option(
    "--setup",
    default="track.yaml",
    show_default=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="Camera file and tags.",
)
@click.option("--print", "printing", is_flag=True, help="Print rows as CSV; needs no daemon.")
@click.option(
    "--overlay",
    type=NewFile(path_type=Path, dir_okay=False),
    help="Image (.png, .jpg) with tags, axes and tip, rewritten twice a second.",
)
@click.option(
    "--tags",
    type=NewFile(path_type=Path, file_okay=False),
    help="Write the tags as images; nothing else.",
)
@socket_option
def command(
    robot: str | None,
    camera: str | None,
    setup: Path,
    printing: bool,
    overlay: Path | None,
    tags: Path | None,
    socket: str | None,
) -> None:
    """Measure the tip of ROBOT in images and send it to the running daemon, as other trackers do.

    ROBOT may be left out when the daemon has only one. The camera must not move. Ctrl-C ends; a report of
    the images follows on stderr.
    """
    from contid_camera.extra import require_extra

    require_extra()
    from contid_camera.frames import frames
    from contid_camera.printed import write_tags
    from contid_camera.run import HEADER, TrackReport, row, track
    from contid_camera.setup_file import read_setup

    if tags is not None:
        for line in write_tags(setup, tags):
            click.echo(line)
        return
    if camera is None:
        raise click.BadParameter("give the number of a camera or a video file", param_hint="--camera")
    if overlay is not None and overlay.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise click.BadParameter(f"{overlay}: give a name that ends in .png or .jpg", param_hint="--overlay")
    loaded = read_setup(setup)
    report = TrackReport()
    try:
        if printing:
            click.echo(HEADER)
            track(loaded, frames(camera), lambda tip: click.echo(row(tip)), overlay, report)
        else:
            from contid.client import Client
            from contid_camera.sending import TipSender

            with Client(socket, name="contid track") as client:
                sender = TipSender(client, lambda line: click.echo(f"contid: {line}", err=True))
                images = frames(camera, paced=True)
                track(loaded, images, lambda tip: sender.send(tip, robot), overlay, report)
    finally:
        # Images of a camera end by Ctrl-C, or by an error.
        if report.images:
            click.echo(str(report), err=True)
    if report.measured == 0:
        sys.exit(1)
