"""The panel as a process beside a run: it ends with the run, and the run never waits for it."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Final, Self

from contid.child_module import module_command

#: How long the end of a run waits for the panel's end.
EXIT_TIMEOUT_S: Final = 5.0


class PanelSubprocess:
    """`contid panel` for the daemon of this process; a context manager."""

    def __init__(self, socket: Path, opens: bool) -> None:
        """Start it for the daemon that listens, or will listen, on a socket; ``opens`` a browser."""
        command = module_command("contid", "panel", "--socket", str(socket), "--wait")
        self._process = subprocess.Popen(
            command + ["--open"] * opens,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            # Ctrl-C in a terminal is for the daemon, which decides how the run ends.
            start_new_session=True,
        )

    def __enter__(self) -> Self:
        """End it on leaving."""
        return self

    def __exit__(self, *error: object) -> None:
        """End it: it watches this end of its stdin."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(EXIT_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
