"""``contid doctor``: problems of host and buses, with remedies."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Iterator

import click

from contid.cli.support.robot_names import robot_names
from contid.hal import Diagnoses, Finding
from contid.robot_file.exchange_time import exchange_time, rate_finding
from contid.robot_file.shipped import load_named


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.option("--json", "as_json", is_flag=True, help="One JSON object per finding.")
def command(robot_file: str, as_json: bool) -> None:
    """Examine the host and the buses and devices of ROBOT_FILE; moves nothing; exit code 4 on an ERROR."""
    from contid.control.engine.wiring import wired_buses
    from contid.control.process.host_checks import examine

    def findings() -> Iterator[Finding]:
        yield from examine()
        for bus in buses:
            wiring = bus.wiring
            time = exchange_time(wiring)
            if time is not None:
                yield rate_finding(wiring.name, time, loaded.file.rate_hz)
            if isinstance(bus.driver, Diagnoses):
                yield from bus.driver.doctor(wiring.name, wiring.options, bus.axes)
            else:
                yield Finding(wiring.name, True, f"driver {wiring.driver!r} has no diagnosis")

    loaded = load_named(robot_file)
    buses = wired_buses(loaded)
    well = True
    for finding in findings():
        well = well and finding.ok
        _print(finding, as_json)
    if not well:
        sys.exit(4)


def _print(finding: Finding, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(dataclasses.asdict(finding)))
        return
    mark = click.style("ok   ", fg="green") if finding.ok else click.style("ERROR", fg="red")
    if finding.warning:
        mark = click.style("warn ", fg="yellow")
    click.echo(f"{mark} {finding.subject}: {finding.message}")
    if finding.remedy:
        click.echo(f"      -> {finding.remedy}")
