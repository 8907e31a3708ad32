"""``contid emulate``: wire-level devices at the ports of a robot file."""

from __future__ import annotations

import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import click

from contid.cli.support.orders import socket_option
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
@click.option(
    "--track", is_flag=True, help="Send the tips of simulated bodies to the daemon, as a tracker does."
)
@socket_option
def command(driver: str, robot_file: str, faults: Path | None, track: bool, socket: str | None) -> None:
    """Emulate the devices of DRIVER in ROBOT_FILE, until Ctrl-C.

    The port a bus names becomes a link to a pseudo terminal; run contid with the same file in another
    terminal, from the same folder. The devices move the body of a robot with `sim`.
    """
    import signal

    from contid.control.engine.wiring import wired_buses
    from contid.control.process.realtime import EMULATED, request_real_time
    from contid_emulate.bodies import EmulatedBodies
    from contid_emulate.tracking import DaemonTracker, moving

    loaded = load_named(robot_file)
    chosen = [bus for bus in wired_buses(loaded) if bus.wiring.driver == driver]
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
        devices = {bus.wiring.name: emulated(bus, faults) for bus in chosen}
        bodies = EmulatedBodies(loaded, devices, time.monotonic())
        if track and not bodies:
            raise ContidError(
                f"{robot_file}: nothing to track: no robot on driver {driver!r} has a simulated body; "
                "add sim: {dynamics: true} to one (docs/robots/dynamics.md)"
            )
        for each in devices.values():
            for line in stack.enter_context(each):
                click.echo(line)
        for line in bodies.lines:
            click.echo(line)
        if bodies:
            notify = partial(click.echo, err=True)
            stack.enter_context(moving(bodies, DaemonTracker(socket, notify) if track else None, notify))
        click.echo("ready; Ctrl-C ends it", err=True)
        if not early:
            signal.sigwait(ends)
    for number in ends:  # the end of the interpreter restores the default action of others
        signal.signal(number, signal.SIG_IGN)
