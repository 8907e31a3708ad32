"""``contid run``: the daemon."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from contid import entry_points
from contid.cli.support.added_options import ExtendedCommand, RunOption, Watch
from contid.cli.support.parameters import NUMBER, NewFile, robot_names

if TYPE_CHECKING:
    from contid.control.daemon.interfaces import RunObserver
    from contid.control.engine.report import RunReport


@click.command(cls=ExtendedCommand, group=entry_points.OBSERVERS)
@click.argument("robot_file", shell_complete=robot_names)
@click.option("--mock", is_flag=True, help="Run on simulated devices instead of the real ones.")
@click.option("--trajectory", type=click.Path(exists=True, dir_okay=False), help="Timed rows; else stdin.")
@click.option("--rate", type=NUMBER, help="Ticks per second instead of rate_hz, within its limits.")
@click.option(
    "--on-end",
    type=click.Choice(["stop", "rest", "hold"]),
    default="stop",
    show_default=True,
    help="When the input ends: stop by stop.on_end of the file and exit, rest and exit, or hold.",
)
@click.option(
    "--unreachable",
    type=click.Choice(["refuse", "nearest"]),
    default="refuse",
    show_default=True,
    help="Targets out of reach: refuse the file (hold, on a live stream), or go to the nearest point.",
)
@click.option(
    "--stretch",
    is_flag=True,
    help="Slow a trajectory down that is too fast for the limits, as little as needed, and follow it.",
)
@click.option("--virtual", is_flag=True, help="Simulated devices in virtual time; repeatable to the bit.")
@click.option(
    "--disarmed",
    is_flag=True,
    help="Connect, read, and wait without torque until `contid resume`: for services that restart.",
)
@click.option(
    "--log", type=click.Path(dir_okay=False), help="Write every command to a new CSV, exact floats."
)
@click.option(
    "--record",
    type=NewFile(dir_okay=False),
    help="Record everything into a session (MCAP); `contid replay` runs it again.",
)
@click.option(
    "--recordings",
    type=click.Path(exists=True, file_okay=False),
    default=".",
    help="Folder of the recordings that clients begin, such as the panel. Default: the present one.",
)
@click.option(
    "--socket",
    type=click.Path(dir_okay=False),
    help="Socket for clients. Default: $XDG_RUNTIME_DIR/contid/NAME.sock, or "
    "contid-UID/NAME.sock in the system's temporary folder; NAME is the robot file's name without .yaml.",
)
@click.option(
    "--socket-group",
    metavar="GROUP",
    help="Members of this group may give orders as well; default: only the daemon's own user and root.",
)
@click.option(
    "--watch-group",
    metavar="GROUP",
    help="Members of this group may read, and hold, stop and estop, and nothing else.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the final report as JSON.")
@click.option("-v", "--verbose", is_flag=True, help="Also print and record debug messages.")
@click.option("-q", "--quiet", is_flag=True, help="Print warnings and errors only.")
def command(
    robot_file: str,
    mock: bool,
    trajectory: str | None,
    rate: float | None,
    on_end: str,
    unreachable: str,
    stretch: bool,
    virtual: bool,
    disarmed: bool,
    log: str | None,
    record: str | None,
    recordings: str,
    socket: str | None,
    socket_group: str | None,
    watch_group: str | None,
    as_json: bool,
    verbose: bool,
    quiet: bool,
    **values: Any,
) -> None:
    """Make the robots of ROBOT_FILE follow a trajectory.

    The trajectory is read from --trajectory or from stdin: timed with a column t_s, else a live stream whose
    newest row is the target. Without input (at a terminal, or < /dev/null) the robots hold and wait for
    orders over the socket: `contid move`, `contid status`, contid.client.
    """
    import logging
    import signal

    from contid.control.daemon.spawn import spawn
    from contid.control.process.nonblocking_stderr import make_stderr_nonblocking

    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # Shells let background jobs ignore it. The run handles it later on, and must not lose it until then.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    make_stderr_nonblocking()
    if stretch and unreachable != "refuse":
        raise click.UsageError("--stretch needs targets within reach: leave out --unreachable nearest")
    watches = _watches(values, virtual)
    # First, because its imports take as long as ours.
    spawned = None if virtual else spawn()
    from contid.control.daemon.run import run
    from contid.control.daemon.run_request import RunRequest
    from contid.control.engine.cycle import OnEnd
    from contid.control.tick.preflight.rows import Unreachable

    observers: list[RunObserver] = []
    recording = None
    options = {"mock": str(mock or virtual), "unreachable": unreachable, "input": trajectory or "stdin"}
    if record is not None:
        from contid.session.recording_observer import RecordingObserver

        recording = RecordingObserver(Path(record), options)
        observers.append(recording)
    observers += [watch.observer for watch in watches if watch.observer is not None]
    commands = []
    with contextlib.ExitStack() as stack:
        if not virtual:
            from contid.remote.protocol.socket_path import Endpoint, default_path
            from contid.remote.server.server import SocketServer
            from contid.session.recordings import Recordings

            path = default_path(robot_file) if socket is None else Path(socket)
            endpoint = Endpoint(path, default=socket is None, group=socket_group, watch_group=watch_group)
            stack.callback(endpoint.close)
            ordered = Recordings(Path(recordings).absolute(), options, recording)
            observers.append(ordered)
            commands.append(SocketServer(endpoint, ordered))
            for watch in watches:
                if watch.beside is not None:
                    stack.enter_context(watch.beside(path))
        request = RunRequest(
            robot_file=robot_file,
            mock=mock or virtual,
            trajectory=trajectory,
            rate_hz=rate,
            on_end=OnEnd(on_end),
            unreachable=Unreachable(unreachable),
            virtual=virtual,
            stretch=stretch,
            armed=not disarmed,
            log=None if log is None else Path(log),
            observers=observers,
            commands=commands,
            log_level=logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO,
        )
        report = run(request, spawned)
    lost = ["the recording"] if recording is not None and recording.lost else []
    lost += [name for watch in watches if (name := watch.lost())]
    if lost and report.exit_code == 0:
        report.ending, report.exit_code = f"{report.ending}, but {lost[0]} is incomplete", 1
    finish(report, as_json)


def _watches(values: Mapping[str, Any], virtual: bool) -> list[Watch]:
    """What watches the run, by the options of extras; refused before anything starts."""
    added: Mapping[str, RunOption] = command.added
    found = [option.prepare(values, virtual) for option in added.values()]
    return [watch for watch in found if watch is not None]


def finish(report: RunReport, as_json: bool) -> None:
    """Print the report and leave with its exit code."""
    if as_json:
        import json

        click.echo(json.dumps(report.as_dict()))
    else:
        click.echo(str(report))
    sys.exit(report.exit_code)
