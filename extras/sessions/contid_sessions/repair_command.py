"""``contid session repair``: a truncated recording becomes whole."""

from __future__ import annotations

from pathlib import Path

import click

from contid.cli.support.parameters import SESSION, NewFile
from contid.cli.support.streams import counting


@click.command()
@SESSION
@click.option("--output", type=NewFile(dir_okay=False), help="Where to; SESSION_FILE is replaced if absent.")
def repair(session_file: str, output: str | None) -> None:
    """Repair a truncated SESSION_FILE.

    The incomplete tick is dropped; the rest is indexed and compressed.
    """
    from contid_sessions.compact import repair as repaired

    with counting("ticks read") as count:
        summary = repaired(Path(session_file), None if output is None else Path(output), count)
    click.echo(summary)
