"""Shared by the commands that send an order to a running daemon: options, response, exit code."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from contid.errors import ContidError, DeviceError

if TYPE_CHECKING:
    from contid.client import Client, RemoteError

#: Remedy for a device that may have missed an order to stop.
UNCONFIRMED: Final = (
    "look at the robot; the devices' own watchdogs stop them; repeat the order when they answer"
)
#: Exit code of an order to stop that a device may have missed, as of one that cannot be reached.
MISSED: Final = DeviceError.exit_code
#: How long an order to stop is repeated while its connection is lost, and the pause between two attempts.
PERSISTENCE_S: Final = 10.0
RETRY_S: Final = 0.02

socket_option = click.option(
    "--socket", type=click.Path(readable=False), help="Socket of the daemon; default: the only one that runs."
)
file_option = click.option(
    "--file",
    type=click.Path(path_type=Path),
    help="File of the operator; default: fleet.yaml here or in ~/.config/contid.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print the response as JSON.")


def order(verb: str, help: str, **options: bool) -> click.Command:
    """A command that sends one order for some robots, or for all of them.

    Args:
        verb: name of the method of `Client`; the command has its name with hyphens.
        help: help of the command.
        options: passed to the method.
    """

    @click.command(
        name=verb.replace("_", "-"), help=f"{help}\n\nROBOTS: names in the robot file; default all."
    )
    @click.argument("robots", nargs=-1)
    @socket_option
    @json_option
    def command(robots: tuple[str, ...], socket: str | None, as_json: bool) -> None:
        send(
            socket,
            as_json,
            lambda client: getattr(client, verb)(robots or None, **options),
            persistent=verb in ("estop", "hold"),
        )

    return command


def send(
    socket: str | None, as_json: bool, request: Callable[[Client], dict[str, Any]], persistent: bool = False
) -> None:
    """Send a request to a daemon and print the response; a refusal keeps its faults in ``--json`` too.

    Exits with 0, and prints ``"ok": true``, only if every robot obeyed and, after an order to stop, every
    axis answered it.

    Args:
        socket: path of the socket of the daemon, None for the only one.
        as_json: print JSON.
        request: made with a client.
        persistent: True for an order to stop: connect and ask again when the connection is lost on the way.
    """
    from contid.client import RemoteError

    try:
        response = _response(socket, request, time.monotonic() + (PERSISTENCE_S if persistent else 0.0))
    except RemoteError as error:
        if as_json:
            click.echo(json.dumps({"ok": False, "error": error.as_fields()}))
            sys.exit(error.exit_code)
        raise RequestRefusedError(error) from None
    refused, silent = response.get("refused", {}), response.get("silent", {})
    if as_json:
        click.echo(json.dumps({"ok": not (refused or silent), **response}))
        sys.exit(2 if refused else MISSED if silent else 0)
    for name, state in response.get("robots", {}).items():
        click.echo(f"{name}: {state}")
        if name in silent:
            devices = ", ".join(silent[name])
            click.echo(f"{name}: {devices} did not answer and may have missed the order: {UNCONFIRMED}")
    for message in response.get("stronger", {}).values():
        click.echo(message)
    if refused:
        messages = refused.values() if isinstance(refused, dict) else refused  # by robot, or of rows
        raise ContidError("refused: " + "; ".join(messages))
    if silent:
        sys.exit(MISSED)


def _response(
    socket: str | None, request: Callable[[Client], dict[str, Any]], until_s: float
) -> dict[str, Any]:
    """The response to a request; connects again after a lost connection until ``until_s`` [monotonic s]."""
    from contid.client import Client, ConnectionLostError, NoDaemonError

    lost: ConnectionLostError | None = None
    while True:
        try:
            with Client(socket, name="contid") as client:
                return request(client)
        except NoDaemonError:
            if lost is not None:  # it has ended meanwhile
                raise lost from None
            raise
        except ConnectionLostError as error:
            lost = error
            if time.monotonic() > until_s:
                raise
        time.sleep(RETRY_S)


class RequestRefusedError(ContidError):
    """A refusal with the explanation of each fault."""

    def __init__(self, error: RemoteError) -> None:
        lines = [str(error)]
        for name, fault in error.faults.items():
            lines.append(f"{name}: fault {fault['number']} {fault['name']}: {fault['what']}")
            lines += [f"  {key}: {fault[key]}" for key in ("cause", "reaction", "remedy")]
        super().__init__("\n".join(lines))
        self.exit_code = error.exit_code
