"""``contid emulate``: wire-level devices at the ports of a robot file."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import click

from contid.cli.support.parameters import robot_names
from contid.errors import ContidError
from contid.robot_file.load import load_named
from contid_emulate.offered import emulated


@click.command()
@click.argument("driver")
@click.argument("robot_file", shell_complete=robot_names)
@click.option(
    "--faults",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File to follow: each line appended to it is one fault switch in JSON.",
)
def command(driver: str, robot_file: str, faults: Path | None) -> None:
    """Emulate the devices of DRIVER in ROBOT_FILE, until Ctrl-C.

    The port a bus names becomes a link to a pseudo terminal; run contid with the same file in another
    terminal, from the same folder.
    """
    import signal

    from contid.control.engine.wiring import wired_buses
    from contid.control.process.realtime import EMULATED, request_real_time

    chosen = [bus for bus in wired_buses(load_named(robot_file)) if bus.wiring.driver == driver]
    if not chosen:
        raise ContidError(f"{robot_file}: no bus with axes has driver {driver!r}")
    # A terminal closes with SIGTERM or SIGHUP as well, and the links must not stay behind. Blocked before any
    # thread starts, so that every thread inherits it and the signal waits for `sigwait`.
    ends = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
    signal.pthread_sigmask(signal.SIG_BLOCK, ends)
    # A further signal goes to a thread of a library that was started before, as numpy's are: there its
    # default action would end the process with the links in place.
    early: list[int] = []
    for number in ends:
        signal.signal(number, lambda received, _frame: early.append(received))
    request_real_time(EMULATED)
    with ExitStack() as stack:
        for bus in chosen:
            for line in stack.enter_context(emulated(bus, faults)):
                click.echo(line)
        click.echo("ready; Ctrl-C ends it", err=True)
        if not early:
            signal.sigwait(ends)
    for number in ends:  # the end of the interpreter restores the default action of others
        signal.signal(number, signal.SIG_IGN)
