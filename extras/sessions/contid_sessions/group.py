"""``contid session info``: what a recording has; extras add to the group."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Final

import click

from contid.cli.support.parameters import SESSION
from contid.cli.support.streams import counting
from contid.cli.support.table import TableGroup

#: Command -> (module:attribute, one line for ``contid session --help``).
SESSIONS: Final[dict[str, tuple[str, str]]] = {
    "info": ("contid_sessions.group:info", "duration, ticks, robots, faults, events, versions"),
}

command = TableGroup(
    SESSIONS, "Sessions", "session", help="Summarise, check, export or repair a recorded session."
)


@click.command()
@SESSION
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def info(session_file: str, as_json: bool) -> None:
    """Print duration, ticks, robots, faults, events, versions."""
    from contid.session.read import Session
    from contid_sessions.info import summarize

    with counting("ticks read") as count:
        summary = summarize(Session(Path(session_file), count))
    click.echo(json.dumps(asdict(summary)) if as_json else str(summary))
