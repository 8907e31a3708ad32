"""``contid new``: a robot file of one's own, copied from a shipped one."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from contid_devices.new_file import Template


def _templates(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from click.shell_completion import CompletionItem

    from contid_devices.new_file import shipped_templates

    return [CompletionItem(name) for name in shipped_templates() if name.startswith(incomplete)]


@click.command()
@click.argument("name")
@click.option(
    "--from",
    "source",
    required=True,
    metavar="ROBOT",
    shell_complete=_templates,
    help="Shipped robot file to copy: finger, hand, trirack, ...",
)
@click.option(
    "--port",
    "ports",
    multiple=True,
    metavar="[BUS=]PORT",
    help="Serial port; once per bus if there are several.",
)
@click.option("--ids", metavar="N,N,...", help="Ids of the servos in the order of the file.")
@click.option(
    "--yes", "-y", is_flag=True, help="Ask nothing; what is not given stays as in the shipped file."
)
def command(name: str, source: str, ports: tuple[str, ...], ids: str | None, yes: bool) -> None:
    """Write NAME.yaml, a copy of a shipped robot file with your name, port and ids.

    contid new my_finger --from finger --port /dev/ttyUSB0 --ids 1,2

    Comments and all other values stay. On a terminal, ports and ids that were not given are asked for. An
    existing file is never overwritten.
    """
    from contid_devices.new_file import file_of, read_template, write_copy

    template, path = read_template(source), file_of(name)
    given_ports = _ports(template, ports)
    given_ids = {} if ids is None else _ids(template, ids)
    if not yes and sys.stdin.isatty():
        given_ports = _ask_ports(template, given_ports)
        if ids is None and template.ids:
            given_ids = _ask_ids(template)
    loaded = write_copy(template, path, given_ports, given_ids)
    click.echo(f"{path}: a copy of {source}")
    for bus, port in template.ports.items():
        if given_ports.get(bus, port) == port and "XXXX" in port:
            click.echo(f"  the port of bus {bus} is still a placeholder: find yours with contid scan")
    if any(robot.placeholder for robot in loaded.file.robots.values()):
        click.echo("  measure the values under placeholder: on your robot, and delete their names there")
    click.echo(f"next: contid check {shlex.quote(str(path))}")


def _ports(template: Template, given: tuple[str, ...]) -> dict[str, str]:
    """The ports of ``--port`` by bus."""
    buses, found = list(template.ports), dict[str, str]()
    for text in given:
        bus, equals, port = text.partition("=")
        if not equals or "/" in bus:
            bus, port = buses[0], text
            if len(buses) > 1:
                raise _bad(
                    "port", f"{template.name} has the buses {', '.join(buses)}: give BUS=PORT for each."
                )
        if bus not in template.ports:
            raise _bad("port", f"{template.name} has no bus {bus!r}; it has {', '.join(buses)}.")
        if bus in found:
            raise _bad("port", f"bus {bus} is given twice.")
        if not port:
            raise _bad("port", f"{text!r} names no port.")
        found[bus] = port
    return found


def _ids(template: Template, text: str) -> dict[str, int]:
    """The numbers of ``--ids`` by axis."""
    axes = list(template.ids)
    if not axes:
        raise _bad("ids", f"the axes of {template.name} have channels, not ids.")
    parts = text.split(",")
    if len(parts) != len(axes):
        raise _bad("ids", f"{len(parts)} given, {len(axes)} needed: {', '.join(axes)}.")
    try:
        return {axis: int(part) for axis, part in zip(axes, parts, strict=True)}
    except ValueError:
        raise _bad("ids", f"{text!r}: whole numbers separated by commas.") from None


def _bad(option: str, message: str) -> click.BadParameter:
    return click.BadParameter(message, param_hint=f"'--{option}'")


def _ask_ports(template: Template, given: Mapping[str, str]) -> dict[str, str]:
    """The ports of all buses; present adapters are offered."""
    from contid_devices.scan import serial_names

    present = sorted(set(serial_names().values()) - set(given.values()))
    if present and len(given) < len(template.ports):
        click.echo(f"serial ports present: {', '.join(present)}")
    asked = dict(given)
    for bus, port in template.ports.items():
        if bus not in given:
            free = [each for each in present if each not in asked.values()]
            asked[bus] = click.prompt(f"port of bus {bus}", default=free[0] if len(free) == 1 else port)
    return asked


def _ask_ids(template: Template) -> dict[str, int]:
    """The ids of all axes."""
    return {
        axis: click.prompt(f"id of axis {axis}", default=number, type=int)
        for axis, number in template.ids.items()
    }
