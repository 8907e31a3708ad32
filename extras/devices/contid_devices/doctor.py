"""``contid doctor``: problems of host and buses, with remedies."""

from __future__ import annotations

import dataclasses
import json
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from contid.cli.support.parameters import robot_names
from contid.errors import ContidError
from contid.hal import Diagnoses, Finding, Identifies
from contid.robot_file.load import LoadedFile, load_named
from contid.robot_file.proven.bringup import bringup_findings, device_finding
from contid.robot_file.tick_rate import exchange_time, rate_finding

if TYPE_CHECKING:
    from contid.control.engine.wiring import WiredBus


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.option("--json", "as_json", is_flag=True, help="One JSON object per finding.")
@click.option("--fix", is_flag=True, help="Install udev rules and real-time priority; asks before each file.")
@click.option("--service", is_flag=True, help="With --fix: the unit as well.")
@click.option("--yes", is_flag=True, help="With --fix: do not ask.")
@click.option("--accept", metavar="BUS", help="Take the devices that answer on BUS as those of this file.")
def command(robot_file: str, as_json: bool, fix: bool, service: bool, yes: bool, accept: str | None) -> None:
    """Examine the host and the buses and devices of ROBOT_FILE; moves nothing; exit code 4 on an ERROR."""
    from contid.control.engine.wiring import wired_buses

    if (service or yes) and not fix:
        raise click.UsageError("--service and --yes go with --fix")
    loaded = load_named(robot_file)
    if fix:
        _fix(service, yes)
    buses = wired_buses(loaded)
    if accept is not None:
        _accept(buses, accept)
    well = True
    for finding in _findings(loaded, buses):
        well = well and finding.ok
        _print(finding, as_json)
    if not well:
        sys.exit(4)


def _findings(loaded: LoadedFile, buses: Sequence[WiredBus]) -> Iterator[Finding]:
    """Findings about the host, then bus by bus, then about the bringup; each is made when it is taken."""
    from contid.control.process.other_devices import other_devices
    from contid_devices.host_checks import examine

    yield from examine()
    for bus in buses:
        wiring = bus.wiring
        time = exchange_time(wiring)
        if time is not None:
            yield rate_finding(wiring.name, time, loaded.file.rate_hz)
        tool = bus.tool(Diagnoses)  # type: ignore[type-abstract]  # a runtime protocol
        if tool is not None:
            yield from tool.doctor(wiring.name, wiring.options, bus.axes)
        else:
            yield Finding(wiring.name, ok=True, message=f"driver {wiring.driver!r} has no diagnosis")
        if loaded.file.bringup:
            with suppress(ContidError):  # a silent bus has findings already
                for other in other_devices(loaded, bus):
                    yield device_finding(other.axis, other.change)
    yield from bringup_findings(loaded)


def _accept(buses: Sequence[WiredBus], name: str) -> None:
    """Accept other devices on a bus than it had before.

    Raises:
        ContidError: no such bus, or its driver does not know devices again.
    """
    bus = next((each for each in buses if each.wiring.name == name), None)
    if bus is None:
        listed = ", ".join(each.wiring.name for each in buses)
        raise ContidError(f"no bus {name!r}; buses: {listed}")
    tool = bus.capable(Identifies, "doctor --accept")  # type: ignore[type-abstract]  # a runtime protocol
    tool.accept(name, bus.wiring.options, bus.axes, lambda line: click.echo(line, err=True))


def _fix(service: bool, yes: bool) -> None:
    """Install what the host lacks.

    Raises:
        ContidError: a file cannot be written.
    """
    from contid_devices.host_files import may_install, missing_files

    files = missing_files(service=service)
    if not files:
        click.echo("nothing to install: all files are there and of this version", err=True)
        return
    if not may_install():
        paths = ", ".join(str(file.path) for file in files)
        program = Path(sys.argv[0]).resolve()
        raise ContidError(f"no right to write {paths}; with it: sudo {program} {shlex.join(sys.argv[1:])}")
    if not (yes or sys.stdin.isatty()):
        raise click.UsageError("--fix asks before each file, and stdin is no terminal; --yes installs all")
    failed: list[str] = []
    for file in files:
        if not yes and not click.confirm(f"Write {file.path}, for {file.purpose}?", err=True):
            continue
        try:
            file.install()
        except ContidError as error:
            failed.append(str(error))
            continue
        click.echo(f"wrote {file.path}" + (f"; next: {file.after}" if file.after else ""), err=True)
    if failed:
        raise ContidError("\n".join(failed))


def _print(finding: Finding, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(dataclasses.asdict(finding)))
        return
    if finding.warning:  # a warning is a finding that is ok with a restriction
        mark = click.style("warn ", fg="yellow")
    elif finding.ok:
        mark = click.style("ok   ", fg="green")
    else:
        mark = click.style("ERROR", fg="red")
    click.echo(f"{mark} {finding.subject}: {finding.message}")
    if finding.remedy:
        click.echo(f"      -> {finding.remedy}")
