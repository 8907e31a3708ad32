"""The panel as a process beside a run: it ends with the run, and the run never waits for it."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from contid.control.daemon.beside import process_beside
from contid.control.daemon.spawn import module_command


@contextmanager
def panel_process(socket: Path, opens: bool, demonstrates: bool = False) -> Iterator[None]:
    """`contid panel` for the daemon that listens, or will listen, on a socket.

    Args:
        socket: of the daemon.
        opens: a browser is opened.
        demonstrates: the input of the run is a demonstration; pages take over without a question.
    """
    command = module_command("contid", "panel", "--socket", str(socket), "--wait")
    with process_beside(command + ["--open"] * opens + ["--demo"] * demonstrates, subprocess.DEVNULL):
        yield
