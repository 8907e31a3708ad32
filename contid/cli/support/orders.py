"""What `contid hold`, `resume`, `stop`, `estop` and `clear-fault` share: options, answer, exit code."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import click

from contid.errors import ContidError

if TYPE_CHECKING:
    from contid.client import Client, RemoteError

#: What becomes of a device that an order to stop does not reach.
UNHEARD: Final = "look at the robot; their own dead-man stops them; order it again when they answer"

socket_option = click.option(
    "--socket", type=click.Path(), help="Of the daemon; default: the only one that runs."
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print the answer as JSON.")


def order(verb: str, does: str) -> click.Command:
    """A command that sends one order for some robots, or for all of them."""

    @click.command(
        name=verb.replace("_", "-"), help=f"{does}\n\nROBOTS: names in the robot file; default all."
    )
    @click.argument("robots", nargs=-1)
    @socket_option
    @json_option
    def command(robots: tuple[str, ...], socket: str | None, as_json: bool) -> None:
        told(socket, as_json, lambda client: getattr(client, verb)(robots or None))

    return command


def told(socket: str | None, as_json: bool, ask: Callable[[Client], dict[str, Any]]) -> None:
    """Ask a daemon and print what it answers; a refusal keeps its faults in ``--json`` too."""
    from contid.client import Client, RemoteError

    try:
        with Client(socket, name="contid") as client:
            answer = ask(client)
    except RemoteError as error:
        if as_json:
            click.echo(json.dumps({"ok": False, "error": error.as_fields()}))
            sys.exit(error.exit_code)
        raise RequestRefusedError(error) from None
    if as_json:
        click.echo(json.dumps({"ok": True, **answer}))
        return
    silent = answer.get("silent", {})
    for name, state in answer.get("robots", {}).items():
        click.echo(f"{name}: {state}")
        if name in silent:
            click.echo(
                f"{name}: {', '.join(silent[name])} did not answer and may not have heard it: {UNHEARD}"
            )


class RequestRefusedError(ContidError):
    """A refusal with what each fault means."""

    def __init__(self, error: RemoteError) -> None:
        lines = [str(error)]
        for name, fault in error.faults.items():
            lines.append(f"{name}: fault {fault['number']} {fault['name']}: {fault['what']}")
            lines += [f"  {key}: {fault[key]}" for key in ("cause", "reaction", "remedy")]
        super().__init__("\n".join(lines))
        self.exit_code = error.exit_code
