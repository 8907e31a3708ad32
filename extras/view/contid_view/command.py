"""``contid view``: show a recorded run."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from contid_view.rerun.session import RerunSession, WebServer


@click.command()
@click.argument("recording", type=click.Path(exists=True, dir_okay=False))
@click.option("--serve", is_flag=True, help="Serve a page for a browser on this machine instead of a window.")
@click.option("--robot", help="Robot file for the shapes instead of the recorded one.")
def command(recording: str, serve: bool, robot: str | None) -> None:
    """Show RECORDING: a session (.mcap) or what `--view FILE.rrd` wrote.

    Nothing leaves this machine: the page is served on the loopback address, statistics are off.
    """
    from contid_view.view_target import Kind, ViewTarget, check

    if robot is not None and recording.endswith(".rrd"):
        raise click.UsageError("--robot is for sessions (.mcap): the shapes of an .rrd are drawn already")
    target = ViewTarget(Kind.SERVE if serve else Kind.SPAWN)
    check(target)
    if recording.endswith(".rrd"):
        _show_file(recording, target.kind is Kind.SERVE)
        return
    from contid.session.read import Session
    from contid_sessions.export_command import file_to_draw
    from contid_view.export import draw

    session = Session(Path(recording))
    entries = ((entry.values, entry.event) for entry in session.entries())
    draw(entries, file_to_draw(session, robot), session.layout, target, on_drawn=_stay)


def _show_file(path: str, serve: bool) -> None:
    from contid_view.rerun.session import WebServer
    from contid_view.window import Window

    if not serve:
        Window(path)
        return
    server = WebServer(path)
    try:
        _wait(server)
    finally:
        server.close()


def _stay(session: RerunSession) -> None:
    if session.server is not None:
        session.recording.flush()
        _wait(session.server)


def _wait(server: WebServer) -> None:
    """Print the URL and serve the page until Ctrl-C or SIGTERM."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    click.echo(server.url)
    click.echo("contid: Ctrl-C ends the page", err=True)
    try:
        server.wait()
    except KeyboardInterrupt:
        return
