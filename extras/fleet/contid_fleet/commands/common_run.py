"""``contid fleet run|replay``: one trajectory for several nodes from one time on, and its recordings."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from contid.cli.support.orders import file_option, json_option
from contid.cli.support.parameters import NumberRange


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
@file_option
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

    from contid_fleet.common_trajectory import read_common_trajectory
    from contid_fleet.conductor import conduct
    from contid_fleet.fleet_file import load_operator_file
    from contid_fleet.net import FleetError
    from contid_fleet.operator import FleetOperator
    from contid_fleet.run_report import OnOne

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
    click.echo(f"experiment {report.experiment}")
    if not report.complete:
        raise FleetError("not every node reached its end")


@click.command("replay")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@json_option
def replay(folder: Path, as_json: bool) -> None:
    """Replay every session (*.mcap) of FOLDER bit for bit, and print the skew of common starts.

    Exit code 1 when a command differs.
    """
    from contid_fleet.fleet_replay import divergence_text, replay_folder

    found = replay_folder(folder)
    if as_json:
        fields = {
            "same": found.same,
            "sessions": {
                path.name: {
                    "ticks": each.ticks,
                    "divergence": None if each.divergence is None else divergence_text(each.divergence),
                    "stopped": each.stopped or None,
                }
                for path, each in found.replayed.items()
            },
            "starts": {
                name: {
                    "skew_ms": round(each.skew_s * 1e3, 3),
                    "bound_ms": round(each.bound_s * 1e3, 3),
                    "late_ms": {node: round(late_s * 1e3, 3) for node, late_s in each.late_s.items()},
                }
                for name, each in found.starts.items()
            },
        }
        click.echo(json.dumps(fields))
        sys.exit(0 if found.same else 1)
    for path, each in found.replayed.items():
        what = (
            "every command equal"
            if each.divergence is None
            else f"differs: {divergence_text(each.divergence)}"
        )
        click.echo(f"{path.name}: {each.ticks} ticks, {each.stopped or what}")
    for name, start in found.starts.items():
        late = ", ".join(f"{node} {late_s * 1e3:+.2f} ms" for node, late_s in start.late_s.items())
        click.echo(f"{name}: {late}; skew {start.skew_s * 1e3:.2f} ms (+-{start.bound_s * 1e3:.2f} ms)")
    sys.exit(0 if found.same else 1)
