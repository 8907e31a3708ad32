"""``contid replay``: a recording through today's code."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import click

from contid.cli.support.parameters import NumberRange
from contid.cli.support.streams import counting


@click.command()
@click.argument("session_file", type=click.Path(exists=True, dir_okay=False))
@click.option("--robot", help="Robot file instead of the recorded one; differences are listed.")
@click.option(
    "--tolerance",
    type=NumberRange(0.0),
    default=0.0,
    show_default=True,
    help="Tolerated difference of commands [mm or bar]; 0 compares bit for bit.",
)
@click.option("--hardware", is_flag=True, help="Send the recorded commands to the real buses.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def command(session_file: str, robot: str | None, tolerance: float, hardware: bool, as_json: bool) -> None:
    """Run the recorded inputs of SESSION_FILE through today's code and compare every command.

    Exit code 1 and the first divergence when one differs.
    """
    from contid.robot_file.load import load_named
    from contid.session.read import Session
    from contid_sessions.replay import report
    from contid_sessions.replay.differences import differences
    from contid_sessions.replay.replay import replay

    given = None if robot is None else load_named(robot)
    if hardware:
        session = Session(Path(session_file))
        if tolerance:
            raise click.UsageError("--tolerance is for comparing; --hardware sends the commands as they are")
        from contid.cli.commands.run import finish
        from contid_sessions.replay.hardware import run_on_hardware

        recorded = session.robot_file(real_buses=True)
        finish(run_on_hardware(session, recorded, given or recorded), as_json)
    with counting("ticks replayed") as count:
        session = Session(Path(session_file), count)
        loaded = given or session.robot_file()
        changed = differences(session.robot_text, loaded.text)
        start_s = time.perf_counter()
        replayed = replay(session, loaded, tolerance)
        took_s = time.perf_counter() - start_s
    result = report.as_json(session, replayed, changed, took_s)
    if as_json:
        click.echo(json.dumps(result))
    else:
        click.echo("\n".join(report.as_text(session, replayed, changed, took_s)))
    sys.exit(0 if result["same"] else 1)
