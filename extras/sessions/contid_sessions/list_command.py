"""``contid session list``: the recordings of a folder."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click


@click.command("list")
@click.argument("folder", default=".", type=click.Path(file_okay=False, path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print the list as JSON.")
def command(folder: Path, as_json: bool) -> None:
    """List the recordings in FOLDER (the present one), the newest first.

    When each began (UTC), how long it is, its size, its robots; and of one that is not whole, why.
    """
    from contid_sessions.listing import recordings_in

    found = recordings_in(folder)
    if as_json:
        click.echo(json.dumps([asdict(each) for each in found]))
    else:
        click.echo("\n".join(map(str, found)) or f"{folder}: no recording (*.mcap) is there")
