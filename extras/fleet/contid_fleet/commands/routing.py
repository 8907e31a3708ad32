"""``contid fleet route`` and ``contid fleet acl``: the router of a fleet, and the access rules of Zenoh."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click


def log_to_stderr(verbose: bool) -> None:
    """Print the log of a program of the fleet; debug messages with ``verbose``."""
    import logging

    level = logging.DEBUG if verbose else logging.INFO
    logging.basicConfig(format="contid: fleet: %(message)s", level=level, stream=sys.stderr)


@click.command("route")
@click.argument("router", type=click.Path(path_type=Path))
@click.option("-v", "--verbose", is_flag=True, help="Print debug messages.")
def route(router: Path, verbose: bool) -> None:
    """Link operators and machines, as the file ROUTER allows, until Ctrl-C.

    Machines and operators connect to it, so that machines listen nowhere. Each operator asks in its own name
    only, and each machine answers for its own nodes only.
    """
    from contid_fleet.router import RouterFile
    from contid_fleet.router import route as pass_on

    log_to_stderr(verbose)
    file = RouterFile.load(router)

    def ready() -> None:
        where = ", ".join(file.endpoints())
        click.echo(f"contid: fleet: the router of {file.fleet} is ready at {where}", err=True)

    pass_on(file, ready)


@click.command("acl")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--router", is_flag=True, help="FILE is that of a router.")
def acl(file: Path, router: bool) -> None:
    """Print the access rules of Zenoh that `fleet serve` (or `fleet route`) uses for FILE, as JSON."""
    from contid_fleet.fleet_file import MachineFile
    from contid_fleet.router import RouterFile

    rules = (RouterFile.load(file) if router else MachineFile.load(file)).access_rules()
    click.echo(json.dumps({"access_control": rules}, indent=2))
