"""``contid fleet ros``: telemetry of a fleet for programs of ROS 2, read only."""

from __future__ import annotations

from pathlib import Path

import click

from contid.cli.support.orders import file_option

#: How long the router of ROS 2 may take to answer.
ROUTER_TIMEOUT_S = 3.0
#: https://docs.ros.org/en/jazzy/Concepts/Intermediate/About-Domain-ID.html
LAST_DOMAIN = 232


@click.command("ros")
@click.option(
    "--router",
    default="tcp/127.0.0.1:7447",
    show_default=True,
    help="Endpoint of the router of ROS 2 (rmw_zenohd).",
)
@click.option(
    "--domain",
    type=click.IntRange(0, LAST_DOMAIN),
    default=0,
    show_default=True,
    help="ROS_DOMAIN_ID of the readers.",
)
@file_option
def command(router: str, domain: int, file: Path | None) -> None:
    """Publish joint states, tips, /tf and /diagnostics of every node in ROS 2 (rmw_zenoh), until Ctrl-C.

    Read only: nothing moves by a topic of ROS 2. The router is one on this machine.
    """
    from contid.errors import ContidError
    from contid_fleet.endpoints import check_endpoint
    from contid_fleet.fleet_file import load_operator_file
    from contid_fleet.net import NetSession
    from contid_fleet.net_settings import NetSettings
    from contid_fleet.operator import FleetOperator
    from contid_fleet.ros.messages import type_store
    from contid_fleet.ros.view import RosPublisher, RosView

    try:
        check_endpoint(router, listening=False)
    except ValueError as error:
        raise ContidError(f"--router: {error}") from None
    type_store()
    operator_file = load_operator_file(file)
    net = NetSession(NetSettings(connect=[router], connect_timeout_s=ROUTER_TIMEOUT_S, mode="client"))
    try:
        with FleetOperator(operator_file) as operator:
            publisher = RosPublisher(net, domain)
            click.echo(f"contid: fleet: publishing at {router}, domain {domain}", err=True)
            RosView(operator, publisher, lambda text: click.echo(text, err=True)).run()
    finally:
        net.close()
