"""``contid session info|export|repair``: what to do with a recording besides replaying it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import click

SESSION = click.argument("session_file", type=click.Path(exists=True, dir_okay=False))


@click.group()
def command() -> None:
    """Look into a recorded session, export it, repair it."""


@command.command()
@SESSION
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def info(session_file: str, as_json: bool) -> None:
    """Duration, ticks, robots, faults, events, versions; clean or cut off."""
    from contid.session.info import summarize
    from contid.session.read import Session

    summary = summarize(Session(Path(session_file)))
    click.echo(json.dumps(summary.as_dict()) if as_json else str(summary))


@command.command()
@SESSION
@click.option("--csv", "csv_path", type=click.Path(), help="FILE.csv: one table; else a folder of channels.")
@click.option("--rrd", "rrd_path", type=click.Path(dir_okay=False), help="A recording for the Rerun viewer.")
@click.option("--robot", help="Robot file for the shapes in the .rrd instead of the recorded one.")
def export(session_file: str, csv_path: str | None, rrd_path: str | None, robot: str | None) -> None:
    """Write SESSION_FILE as CSV (mm, bar) or as a Rerun recording."""
    from contid.session.read import Session

    if csv_path is None and rrd_path is None:
        raise click.UsageError("say where to: --csv FOLDER, --csv FILE.csv, --rrd FILE.rrd")
    session = Session(Path(session_file))
    if csv_path is not None:
        from contid.session.export import export_channels, export_joined

        if csv_path.endswith(".csv"):
            export_joined(session, Path(csv_path))
            click.echo(csv_path)
        else:
            for path in export_channels(session, Path(csv_path)):
                click.echo(str(path))
    if rrd_path is not None:
        from contid.description.load import load_robot_file
        from contid.description.shipped import find_robot_file

        os.environ.setdefault("RUST_LOG", "off")  # what goes wrong is said by contid
        from contid.view.export import export_rrd

        loaded = session.robot_file() if robot is None else load_robot_file(find_robot_file(robot))
        entries = ((entry.values, entry.event) for entry in session.entries())
        export_rrd(entries, loaded, session.layout, Path(rrd_path))
        click.echo(rrd_path)


@command.command()
@SESSION
@click.option(
    "--output", type=click.Path(dir_okay=False), help="Where to; SESSION_FILE is replaced if absent."
)
def repair(session_file: str, output: str | None) -> None:
    """Make a cut-off SESSION_FILE whole: indexed, compressed, without the tick that was cut."""
    from contid.session.compact import compact
    from contid.session.info import summarize, today
    from contid.session.read import Session

    source = Path(session_file)
    session = Session(source)
    before = summarize(session)
    if session.clean and session.chunked and output is None:
        click.echo(f"{source}: nothing to repair")
        return
    note = {} if session.clean else {"repaired": {"when": today(), "found": session.cut}}
    target = compact(source, None if output is None else Path(output), note)
    after = summarize(Session(target))
    click.echo(f"{target}: {after.ticks} of {before.ticks} ticks, {after.state}")
