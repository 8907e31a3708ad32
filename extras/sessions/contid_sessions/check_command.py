"""``contid session check``: the motion of a recording against the rules."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from itertools import islice
from pathlib import Path

import click

from contid.cli.support.parameters import SESSION
from contid.cli.support.streams import counting

#: Violations that a check lists.
MAX_VIOLATIONS = 100


@click.command()
@SESSION
@click.option("--json", "as_json", is_flag=True, help="Print the violations as JSON.")
def command(session_file: str, as_json: bool) -> None:
    """Check the motion of SESSION_FILE against the rules, from its records alone.

    Limits of position, velocity, acceleration and jerk; no jump at arming; measured axes that follow their
    commands; an emergency stop within its tick; growing time; an event for every fault. Exit code 1 when a
    rule was broken.
    """
    from contid.session.read import Session
    from contid_sessions.check import check_session

    with counting("ticks read") as count:
        session = Session(Path(session_file), count)
        found = list(islice(check_session(session), MAX_VIOLATIONS + 1))
    more = len(found) > MAX_VIOLATIONS
    found = found[:MAX_VIOLATIONS]
    if as_json:
        click.echo(
            json.dumps({"ok": not found, "more": more, "violations": [asdict(each) for each in found]})
        )
    else:
        lines = [*map(str, found), "further violations are not listed"] if more else [*map(str, found)]
        click.echo("\n".join(lines) or "no rule of motion was broken")
    if session.end.cut and not more:
        click.echo(f"contid: {session.path}: {session.end.cut}; checked as far as it goes", err=True)
    if found:
        sys.exit(1)
