"""``contid session merge``: sessions of several nodes in one file."""

from __future__ import annotations

from pathlib import Path

import click

from contid.cli.support.files import NewFile


@click.command("merge")
@click.argument("sessions", nargs=-1, required=True, type=click.Path(exists=True, dir_okay=False))
@click.option(
    "-o", "--output", required=True, type=NewFile(dir_okay=False), help="New file, for Foxglove and others."
)
def command(sessions: tuple[str, ...], output: str) -> None:
    """Lay SESSIONS of the nodes of a fleet run on one clock, in one file with channels /NODE/tick and so on.

    The times are those of the machine that conducted the run. A merged file is for looking at: check, export
    and replay take the originals.
    """
    from contid.session.merge import merge_sessions

    report = merge_sessions([Path(path) for path in sessions], Path(output))
    for name, count in report.messages.items():
        start_s, bound_ms = report.start_s[name], report.bound_s[name] * 1e3
        click.echo(f"{name}: {count} messages, from {start_s:.3f} s on (+-{bound_ms:.2f} ms)")
