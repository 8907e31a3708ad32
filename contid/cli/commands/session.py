"""``contid session info|repair``: what a recording has, and how it becomes whole; extras add to the group."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Final

import click

from contid.cli.support.parameters import SESSION, NewFile
from contid.cli.support.streams import counting
from contid.cli.support.table import TableGroup

#: Command -> (module:attribute, one line for ``contid session --help``).
SESSIONS: Final[dict[str, tuple[str, str]]] = {
    "info": ("contid.cli.commands.session:info", "duration, ticks, robots, faults, events, versions"),
    "repair": ("contid.cli.commands.session:repair", "a truncated recording"),
}

command = TableGroup(
    SESSIONS, "Sessions", "session", help="Summarise, check, export or repair a recorded session."
)


@click.command()
@SESSION
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def info(session_file: str, as_json: bool) -> None:
    """Print duration, ticks, robots, faults, events, versions."""
    from contid.session.info import summarize
    from contid.session.read import Session

    with counting("ticks read") as count:
        summary = summarize(Session(Path(session_file), count))
    click.echo(json.dumps(asdict(summary)) if as_json else str(summary))


@click.command()
@SESSION
@click.option("--output", type=NewFile(dir_okay=False), help="Where to; SESSION_FILE is replaced if absent.")
def repair(session_file: str, output: str | None) -> None:
    """Repair a truncated SESSION_FILE.

    The incomplete tick is dropped; the rest is indexed and compressed.
    """
    from contid.session.compact import repair as repaired

    with counting("ticks read") as count:
        summary = repaired(Path(session_file), None if output is None else Path(output), count)
    click.echo(summary)
