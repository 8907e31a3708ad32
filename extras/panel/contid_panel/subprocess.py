"""The panel as a process beside a run: it ends with the run, and the run never waits for it."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from contid.control.daemon.spawn import module_command

#: How long the end of a run waits for the panel's end.
EXIT_TIMEOUT_S: Final = 5.0


@contextmanager
def panel_process(socket: Path, opens: bool, demonstrates: bool = False) -> Iterator[None]:
    """`contid panel` for the daemon that listens, or will listen, on a socket.

    Args:
        socket: of the daemon.
        opens: a browser is opened.
        demonstrates: the input of the run is a demonstration; pages take over without a question.
    """
    command = module_command("contid", "panel", "--socket", str(socket), "--wait")
    process = subprocess.Popen(
        command + ["--open"] * opens + ["--demo"] * demonstrates,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        # Ctrl-C in a terminal is for the daemon, which decides how the run ends.
        start_new_session=True,
    )
    assert process.stdin is not None
    try:
        yield
    finally:
        process.stdin.close()  # it watches this end
        try:
            process.wait(EXIT_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
