"""``contid fleet feed``: the periodic message without which robots with ``hold_without_feed`` hold."""

from __future__ import annotations

import time
from pathlib import Path

import click

from contid.cli.support.orders import file_option
from contid.cli.support.parameters import NumberRange


@click.command("feed")
@click.option(
    "--rate", type=NumberRange(1.0, 50.0), default=10.0, show_default=True, help="Feeds per second."
)
@file_option
def command(rate: float, file: Path | None) -> None:
    """Feed every machine until Ctrl-C; when the feed ends, the robots that require it hold.

    The file of their machine has `hold_without_feed: {operator: NAME, after_s: 0.5}`. Prints which machines
    are fed. Best effort: never the only stop of a robot.
    """
    from contid_fleet.fleet_file import load_operator_file
    from contid_fleet.operator import FleetOperator, response_of
    from contid_fleet.rights import FEED

    shown: dict[str, str] = {}

    def answered(key: str, payload: bytes) -> None:
        node, response = operator.keys.node(key), response_of(payload)
        if response.get("ok"):
            text = f"fed; its robots hold {response['result']['after_s']:g} s after the last feed"
        else:
            text = str(response["error"]["message"])
        if shown.get(node) != text:
            shown[node] = text
            click.echo(f"{node}: {text}")

    with FleetOperator(load_operator_file(file)) as operator:
        # In this loop, not in a thread: a program that hangs feeds nothing.
        while True:
            operator.net.ask(operator.key("*", FEED), b"", 1.0, answered, urgent=True)
            time.sleep(1.0 / rate)
