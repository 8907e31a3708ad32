"""``contid fleet run``: one trajectory for several nodes that begin at one time."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from contid.cli.support.numbers import NumberRange
from contid.cli.support.orders import json_option


@click.command("run")
@click.argument("trajectory", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--on-one",
    type=click.Choice(["hold_all", "go_on"]),
    default="hold_all",
    show_default=True,
    help="What the others do when a node does not reach its end.",
)
@click.option("--takeover", is_flag=True, help="Take the leases from their holders; the robots hold.")
@click.option("--lease", type=NumberRange(0.3, 5.0), default=1.0, show_default=True, help="Seconds.")
@click.option(
    "--file",
    type=click.Path(path_type=Path),
    help="File of the operator; default: fleet.yaml here or in ~/.config/contid.",
)
@json_option
def command(
    trajectory: Path, on_one: str, takeover: bool, lease: float, file: Path | None, as_json: bool
) -> None:
    """Let several nodes follow one timed TRAJECTORY (CSV: t_s, NODE/COLUMN...) from one common time on.

    All leases are taken or none; the rows are checked at every node before a robot moves; all robots go to
    the first row and wait there; then all begin at one time. What fails before that makes all hold. Exit code
    0 only if every node reached its end.
    """
    import asyncio

    from contid.fleet.common_trajectory import read_common_trajectory
    from contid.fleet.conductor import OnOne, conduct
    from contid.fleet.fleet_file import load_operator_file
    from contid.fleet.net import FleetError
    from contid.fleet.operator import FleetOperator

    parts = read_common_trajectory(trajectory)
    with FleetOperator(load_operator_file(file)) as operator:
        report = asyncio.run(
            conduct(
                operator,
                parts,
                lease_s=lease,
                takeover=takeover,
                on_one=OnOne(on_one),
                progress=lambda step: click.echo(f"contid: fleet run: {step}", err=True),
            )
        )
    if as_json:
        click.echo(json.dumps(report.as_fields()))
        sys.exit(0 if report.complete else FleetError.exit_code)
    for name, each in report.nodes.items():
        began = "its start is not known"
        if each.late_s is not None:
            began = f"began in tick {each.tick}, {each.late_s * 1e3:+.2f} ms (+-{each.bound_s * 1e3:.2f} ms)"
        click.echo(f"{name}: {began}; {each.error or 'reached its end'}")
    if (skew_s := report.skew_s) is not None:
        tick_ms, bound_ms = report.tick_s * 1e3, report.bound_s * 1e3
        click.echo(f"skew {skew_s * 1e3:.2f} ms (+-{bound_ms:.2f} ms; a tick is {tick_ms:g} ms)")
    if not report.complete:
        raise FleetError("not every node reached its end")
