"""``contid doctor``: what is wrong, and what to do about it."""

from __future__ import annotations

import dataclasses
import json
import sys

import click

from contid.cli.support.robot_names import robot_names
from contid.hal import Diagnoses, Finding
from contid.robot_file.load import load_robot_file
from contid.robot_file.shipped import find_robot_file


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.option("--json", "as_json", is_flag=True, help="One JSON object per finding.")
def command(robot_file: str, as_json: bool) -> None:
    """Examine the machine and the buses and devices of ROBOT_FILE; moves nothing; exit 4 if not well."""
    from contid.cli.support.buses import wired_buses
    from contid.control.process.host_checks import examine

    loaded = load_robot_file(find_robot_file(robot_file))
    well = True
    for finding in examine():
        well = well and finding.ok
        _print(finding, as_json)
    for bus in wired_buses(loaded):
        wiring = bus.wiring
        if isinstance(bus.driver, Diagnoses):
            findings = bus.driver.doctor(wiring.name, wiring.options, bus.axes)
        else:
            findings = [Finding(wiring.name, True, f"driver {wiring.driver!r} examines nothing")]
        for finding in findings:
            well = well and finding.ok
            _print(finding, as_json)
    if not well:
        sys.exit(4)


def _print(finding: Finding, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(dataclasses.asdict(finding)))
        return
    mark = click.style("ok   ", fg="green") if finding.ok else click.style("WRONG", fg="red")
    click.echo(f"{mark} {finding.subject}: {finding.message}")
    if finding.remedy:
        click.echo(f"      -> {finding.remedy}")
