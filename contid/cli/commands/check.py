"""``contid check``: validate a robot file, or a trajectory for it."""

from __future__ import annotations

import dataclasses
import json

import click

from contid.cli.support.parameters import robot_names
from contid.entry_points import RECORDINGS, required


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.argument("trajectory", required=False, type=click.Path(dir_okay=False, exists=True, allow_dash=True))
@click.option(
    "--budget",
    is_flag=True,
    help="Also measure what a tick takes of its period on this machine; 2 if it does not fit.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object; of a bad file one per mistake.")
def command(robot_file: str, trajectory: str | None, budget: bool, as_json: bool) -> None:
    """Validate ROBOT_FILE (or a shipped one by its name) and print what it describes.

    With TRAJECTORY (`-`: stdin), check that instead, as `contid run` does before it moves anything: reach,
    limits and speed of every row and of the way between. No device is opened.

    With --budget it runs the robots in virtual time, standing, on a timed path and on a live stream; `contid
    run` refuses a file whose tick takes above 80 % of its period. It also records a part of the stream, and
    prints how large recordings become.

    A bad file ends with exit code 2 and every mistake as file:line:column: what; allowed; nearest name.
    """
    from contid.errors import BadInputError, ContidError
    from contid.robot_file.load import load_named
    from contid.robot_file.needs import require_extras
    from contid.robot_file.proven.bringup import bringup_findings
    from contid.robot_file.summary import summarise

    if budget and trajectory is not None:
        raise click.UsageError("--budget is for a robot file alone: leave out the trajectory")
    try:
        if trajectory is not None:
            from contid.control.daemon.check_trajectory import check_trajectory

            checked = check_trajectory(robot_file, trajectory)
            click.echo(
                json.dumps(dataclasses.asdict(checked))
                if as_json
                else f"{'stdin' if trajectory == '-' else trajectory}: {checked}"
            )
            return
        loaded = load_named(robot_file)
        require_extras(loaded)
    except BadInputError as error:
        if not as_json:
            raise
        for found in error.findings:
            where = {"file": found.file, "line": found.line, "column": found.column}
            click.echo(json.dumps({**where, "message": found.message}))
        raise SystemExit(error.exit_code) from error
    from contid.kernels import in_use
    from contid.trajectory.columns import column_groups

    build = in_use()
    report = summarise(loaded)
    alone = len(loaded.file.robots) == 1
    columns = {
        name: column_groups("" if alone else f"{name}.", robot)
        for name, robot in loaded.file.robots.items()
        if not robot.passive
    }
    measured = None
    if budget:
        measured = required(RECORDINGS, "budget_report", "contid check --budget", "sessions")(loaded)
    refusal = "" if measured is None else measured.refusal()
    if as_json:
        costs = {} if measured is None else {"budget": measured.as_dict()}
        click.echo(json.dumps({**report, "columns": columns, "kernels": build, **costs}))
        raise SystemExit(2 if refusal else 0)
    from contid.cli.support.check_table import print_report

    print_report(report, columns)
    for finding in bringup_findings(loaded):
        if finding.remedy:
            click.echo(f"{finding.subject}: {finding.message}; {finding.remedy}")
    click.echo(f"kernels: {build}")
    if measured is not None:
        click.echo("\n".join(measured.lines()))
    if refusal:
        raise ContidError(f"{loaded.path}: {refusal}")
