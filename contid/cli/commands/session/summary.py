"""``contid session info|repair``: what a recording has, and how it becomes whole."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from contid.cli.support.parameters import SESSION, NewFile
from contid.cli.support.streams import counting


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
