"""``contid fleet feed``: the periodic message without which robots with ``hold_without_feed`` hold."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import click

from contid.cli.support.orders import file_option
from contid.cli.support.parameters import NumberRange
from contid.remote.protocol.wire import Fields

#: A machine is reported that has not answered for this time, or for this number of feeds.
SILENT_S: Final = 1.0
SILENT_FEEDS: Final = 3.0


class FedMachines:
    """Reports of every machine when it is fed, refuses, or answers no more; `take` from any thread.

    Args:
        silent_s: without an answer for this time a machine is no longer fed.
        report: called with a line per change.
    """

    def __init__(self, silent_s: float, report: Callable[[str], object]) -> None:
        self._silent_s = silent_s
        self._report = report
        self._shown: dict[str, str] = {}
        self._answered_s: dict[str, float] = {}

    def take(self, node: str, response: Fields, now_s: float) -> None:
        """Take an answer of a machine."""
        self._answered_s[node] = now_s
        if response.get("ok"):
            self._show(node, f"fed; its robots hold {response['result']['after_s']:g} s after the last feed")
        else:
            self._show(node, str(response["error"]["message"]))

    def look(self, now_s: float) -> None:
        """Report machines that answer no more."""
        for node, answered_s in dict(self._answered_s).items():
            if now_s - answered_s > self._silent_s:
                self._show(node, f"not fed: no answer for {self._silent_s:g} s; look at its bridge")

    def _show(self, node: str, text: str) -> None:
        if self._shown.get(node) != text:
            self._shown[node] = text
            self._report(f"{node}: {text}")


@click.command("feed")
@click.option(
    "--rate", type=NumberRange(1.0, 50.0), default=10.0, show_default=True, help="Feeds per second."
)
@file_option
def command(rate: float, file: Path | None) -> None:
    """Feed every machine until Ctrl-C; when the feed ends, the robots that require it hold.

    The file of their machine has `hold_without_feed: {operator: NAME, after_s: 0.5}`. Prints which machines
    are fed, and which no longer are. Best effort: never the only stop of a robot.
    """
    from contid_fleet.fleet_file import load_operator_file
    from contid_fleet.operator import FleetOperator, response_of
    from contid_fleet.rights import FEED

    fed = FedMachines(max(SILENT_S, SILENT_FEEDS / rate), click.echo)

    def answered(key: str, payload: bytes) -> None:
        fed.take(operator.keys.node(key), response_of(payload), time.monotonic())

    with FleetOperator(load_operator_file(file)) as operator:
        # In this loop, not in a thread: a program that hangs feeds nothing.
        while True:
            operator.net.ask(operator.key("*", FEED), b"", 1.0, answered, urgent=True)
            time.sleep(1.0 / rate)
            fed.look(time.monotonic())
