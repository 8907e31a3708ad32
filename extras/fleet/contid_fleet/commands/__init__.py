"""``contid fleet``: robots on several machines: the bridge, one table, one stop, moves."""

from __future__ import annotations

import json
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click

from contid.cli.support.orders import file_option, json_option
from contid.cli.support.parameters import ROWS_FILE, NumberRange
from contid_fleet.commands.common_run import command as run
from contid_fleet.commands.common_run import replay
from contid_fleet.commands.feed import command as feed
from contid_fleet.commands.ros import command as ros
from contid_fleet.commands.routing import acl, log_to_stderr, route

if TYPE_CHECKING:
    from contid_fleet.operator import Answers, FleetOperator


@click.group()
def command() -> None:
    """Robots on several machines; docs/fleet.md goes from two machines to one stop.

    A stop by network is best effort and never the only stop of a robot.
    """


@command.command("serve")
@click.argument("machine", type=click.Path(path_type=Path))
@click.option("--metrics", metavar="127.0.0.1:PORT", help="Serve a page /metrics for Prometheus there.")
@click.option("-v", "--verbose", is_flag=True, help="Print debug messages.")
def serve(machine: Path, metrics: str | None, verbose: bool) -> None:
    """Offer the daemons of this machine to the network, as the file MACHINE allows, until Ctrl-C.

    The leases stay in the daemons: when the operator, the network or this process stands still, they lapse
    and the robots hold.
    """
    from contid_fleet.bridge import serve as serve_bridge
    from contid_fleet.fleet_file import MachineFile
    from contid_fleet.metrics_server import metrics_address

    address = None if metrics is None else metrics_address(metrics)
    log_to_stderr(verbose)
    file = MachineFile.load(machine)

    def ready() -> None:
        where = ", ".join(file.endpoints())
        click.echo(f"contid: fleet: {file.fleet} is ready at {where}", err=True)

    serve_bridge(file, ready, address)


def _operator(file: Path | None) -> FleetOperator:
    from contid_fleet.fleet_file import load_operator_file
    from contid_fleet.operator import FleetOperator

    return FleetOperator(load_operator_file(file))


@command.command("status")
@click.option("--watch", is_flag=True, help="Repeat until Ctrl-C.")
@click.option(
    "--rate", type=NumberRange(0.2, 10.0), default=2.0, show_default=True, help="Updates per second."
)
@file_option
@json_option
def status(watch: bool, rate: float, file: Path | None, as_json: bool) -> None:
    """Show the robots of every node; exit code 4 while a node does not answer, 3 while one is in FAULT."""
    from rich.live import Live

    from contid_fleet.commands.render_fleet import render_nodes

    live = Live(auto_refresh=False)
    with _operator(file) as operator, live if watch else nullcontext():
        while True:
            begin_s = time.monotonic()
            answers = operator.ask_all("status", {})
            if as_json:
                click.echo(json.dumps({"nodes": answers.by_node, "missing": answers.missing}))
            elif watch and live.console.is_terminal:
                live.update(render_nodes(answers), refresh=True)
            else:
                live.console.print(render_nodes(answers))
                if answers.unlinked:
                    click.echo(f"{answers.unlinked} of the endpoints of the file: no link", err=True)
            if not watch:
                sys.exit(_code(answers))
            time.sleep(max(begin_s + 1.0 / rate - time.monotonic(), 0.0))


def _code(answers: Answers) -> int:
    """The exit code of a status: 4 when it is not whole, 3 while a robot is in FAULT."""
    robots = [
        robot
        for response in answers.by_node.values()
        for robot in response.get("result", {}).get("robots", {}).values()
    ]
    refused = [name for name, response in answers.by_node.items() if not response.get("ok")]
    if answers.missing or answers.unlinked or answers.doubled or refused or not robots:
        return 4
    return 3 if any(robot.get("fault") for robot in robots) else 0


def _stop(verb: str, help: str) -> click.Command:
    @command.command(
        verb,
        help=f"{help}\n\nNODES: names; default every node. Exit code 0 only if each one confirmed for every "
        "robot within 1 s. Best effort: never the only stop of a robot.",
    )
    @click.argument("nodes", nargs=-1)
    @file_option
    @json_option
    def stop(nodes: tuple[str, ...], file: Path | None, as_json: bool) -> None:
        from contid_fleet.commands.render_fleet import REMEDY, stop_lines
        from contid_fleet.net import FleetError
        from contid_fleet.operator import ANSWER_TIMEOUT_S
        from contid_fleet.stops import stop_fleet

        with _operator(file) as operator:
            report = stop_fleet(operator, verb, nodes)
        if as_json:
            click.echo(json.dumps(report.as_fields()))
            sys.exit(0 if report.complete else FleetError.exit_code)
        for line in stop_lines(report, ANSWER_TIMEOUT_S):
            click.echo(line)
        if not report.confirmed and not report.refused and not report.missing:
            raise FleetError(f"no node is known: {REMEDY}")
        if not report.complete:
            raise FleetError(f"{verb}: not every node confirmed: {REMEDY}")

    return stop


hold = _stop("hold", "Stop the robots of the fleet with limited jerk and stay.")
stop = _stop("stop", "Stop the robots of the fleet by stop.on_interrupt of their robot files.")
estop = _stop("estop", "Relax or vent the robots of the fleet at once.")


@command.command("move")
@click.argument("node")
@click.argument("message", nargs=-1, metavar="[ROBOT] COLUMN=VALUE...")
@click.option("--trajectory", type=ROWS_FILE, help="CSV rows to follow instead of a point; - for stdin.")
@click.option("--takeover", is_flag=True, help="Take the lease from its holder; the robots hold.")
@click.option("--lease", type=NumberRange(0.1, 5.0), default=1.0, show_default=True, help="Seconds.")
@file_option
def move(
    node: str,
    message: tuple[str, ...],
    trajectory: TextIO | None,
    takeover: bool,
    lease: float,
    file: Path | None,
) -> None:
    """Send the robots of one NODE to a point, or along the rows of --trajectory, and hold there."""
    from contid.client import Client
    from contid.errors import ContidError
    from contid.remote.client.move_arguments import point, rows_to_send
    from contid_fleet.fleet_address import FleetAddress

    if (trajectory is None) == (not message):
        raise click.UsageError("give a point (COLUMN=VALUE...) or --trajectory, one of them")
    target = point(message) if trajectory is None else {}
    followed = None if trajectory is None else rows_to_send(trajectory)
    refused: list[str] = []
    with _operator(file) as operator, Client(FleetAddress(operator, node), name="fleet move") as client:
        client.acquire(lease, takeover=takeover)
        if followed is None:
            client.move(target)
        else:
            columns, rows = followed
            refused = [rows.located(each) for each in client.stream(columns, rows)]
    if refused:
        raise ContidError("refused: " + "; ".join(refused))


command.add_command(route)
command.add_command(acl)
command.add_command(ros)
command.add_command(run)
command.add_command(replay)
command.add_command(feed)


@command.command("init")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option("--fleet", required=True, help="Name of the fleet.")
def init(folder: Path, fleet: str) -> None:
    """Write the CA of a new fleet into FOLDER; its ca.key signs every certificate and stays there."""
    from contid_fleet.certificates import make_ca

    ca = make_ca(folder, fleet)
    click.echo(
        f"{ca}: goes to every machine and operator; {ca.with_suffix('.key')}: keep it here, and secret"
    )


@command.command("cert")
@click.argument("name")
@click.option(
    "--ca", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder of `fleet init`."
)
@click.option("--host", "hosts", multiple=True, help="For a machine: its IP address or name; repeat it.")
@click.option(
    "--days", type=NumberRange(0.01, 825.0), default=30.0, show_default=True, help="Until it expires."
)
@click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), default=Path(), help="Folder for the files."
)
def cert(name: str, ca: Path, hosts: tuple[str, ...], days: float, out: Path) -> None:
    """Write NAME.pem and NAME.key: for an operator of that name or, with --host, for a machine."""
    from contid_fleet.certificates import make_certificate

    path = make_certificate(out, ca, name, hosts, days)
    kind = "machine" if hosts else "operator"
    click.echo(f"{path} and {path.with_suffix('.key')}: {kind} {name}, {days:g} days")
