"""``contid panel`` and ``contid demo``: robots in a browser, of a running daemon or simulated."""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path

import click

from contid.cli.support.orders import socket_option
from contid.cli.support.parameters import robot_names


@click.command()
@socket_option
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option(
    "--port", type=click.IntRange(0, 65535), help="Port; default 8421, or a free one if it is taken."
)
@click.option("--read-only", is_flag=True, help="Pages show and stop, and give no other order.")
@click.option("--open", "opens", is_flag=True, help="Open the page in a browser on this machine.")
@click.option("--allow-remote", is_flag=True, help="Let other machines connect; with --host and TLS only.")
@click.option("--tls-certificate", type=click.Path(exists=True, dir_okay=False), help="Certificate (PEM).")
@click.option("--tls-key", type=click.Path(exists=True, dir_okay=False), help="Its private key (PEM).")
@click.option("--name", "names", multiple=True, help="Further name by which browsers address this machine.")
@click.option("--demo", "demonstrates", is_flag=True, hidden=True, help="The input is a demonstration.")
@click.option("--wait", is_flag=True, hidden=True, help="Start before the daemon; end with stdin.")
def command(
    socket: str | None,
    host: str,
    port: int | None,
    read_only: bool,
    opens: bool,
    allow_remote: bool,
    tls_certificate: str | None,
    tls_key: str | None,
    names: tuple[str, ...],
    demonstrates: bool,
    wait: bool,
) -> None:
    """Serve a page that shows and moves the robots of a running daemon.

    The printed URL contains a secret token: a browser that has it can move the robots. From another machine
    use a tunnel: `ssh -L 8421:127.0.0.1:8421 HOST`, then open the URL there.
    """
    from contid.remote.protocol.socket_path import find, is_listening
    from contid.remote.protocol.wire import NoDaemonError
    from contid_panel.open_browser import open_browser
    from contid_panel.server import PanelSettings, serve

    path = Path(socket) if wait and socket is not None else find(socket)
    settings = PanelSettings(
        socket=path,
        host=host,
        port=port,
        read_only=read_only,
        allow_remote=allow_remote,
        certificate=None if tls_certificate is None else Path(tls_certificate),
        key=None if tls_key is None else Path(tls_key),
        names=names,
        demonstrates=demonstrates,
    )

    settings.check()
    if not wait and not is_listening(path):
        raise NoDaemonError(f"{path}: no daemon listens there; start one with `contid run ROBOT.yaml`")

    def ready(url: str) -> None:
        if wait:
            click.echo(f"contid: panel: {url}", err=True)
        else:
            click.echo(url)
            click.echo("contid: panel: Ctrl-C ends the page", err=True)
        if opens:
            open_browser(url)

    if wait:
        _end_with_stdin()
    serve(settings, ready)


def _end_with_stdin() -> None:
    """End this process when the process that started it ends: its end of the pipe closes then."""
    stdin = sys.stdin.fileno()

    def watch() -> None:
        while os.read(stdin, 4096):  # a thread in `sys.stdin.buffer` would abort the end of the interpreter
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, daemon=True).start()


@click.command()
@click.argument("robot_file", default="hand", shell_complete=robot_names)
@click.option("--no-open", is_flag=True, help="Print the URL and open no browser.")
@click.option("--still", is_flag=True, help="The robots hold, and do not move by themselves.")
@click.pass_context
def demo(ctx: click.Context, robot_file: str, no_open: bool, still: bool) -> None:
    """Run ROBOT_FILE (the two-fingered hand) on simulated devices with the panel.

    The robots move gently until control is taken. Apart from that it is `contid run ROBOT_FILE --mock
    --panel`, and a browser is opened on it. Ctrl-C ends both.
    """
    from contid.cli.commands import run
    from contid.robot_file.load import load_named
    from contid_panel.demo_motion import demo_motion

    loaded = load_named(robot_file)
    motion = None if still else demo_motion(loaded, loaded.file.rate_hz)
    # `contid run` would read the stdin of a calling script as a trajectory.
    if motion is None:
        reads = os.open(os.devnull, os.O_RDONLY)
    else:
        reads, writes = os.pipe()
        threading.Thread(target=motion.feed, args=(writes,), daemon=True).start()
    os.dup2(reads, sys.stdin.fileno())
    os.close(reads)
    screen = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    ctx.invoke(
        run.command,
        robot_file=robot_file,
        mock=True,
        on_end="hold",
        panel=True,
        panel_open=screen and not no_open,
        panel_demo=motion is not None,
    )
