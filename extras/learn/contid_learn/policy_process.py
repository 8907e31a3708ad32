"""A policy in a process beside a run: the tick never waits for it; one that hangs loses its lease."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from contid.control.daemon.spawn import module_command
from contid_learn.drive import load_drive

#: How long the end of a run waits for the end of the policy.
EXIT_TIMEOUT_S: Final = 5.0


class PolicyProcess:
    """The process of one run.

    Args:
        robot_file: of the run.
        file: of the policy; read here too, so that a wrong one is refused before anything moves.
        goal: text of ``--goal``.
        duration_s: after which the policy ends the run; None: never.

    Attributes:
        failed: what is incomplete because the process failed, "" while nothing is.
    """

    def __init__(self, robot_file: str, file: str, goal: str, duration_s: float | None) -> None:
        load_drive(robot_file, file, goal)
        self._arguments = [robot_file, file, goal, *([] if duration_s is None else [str(duration_s)])]
        self.failed = ""

    @contextmanager
    def beside(self, socket: Path) -> Iterator[None]:
        """Drive the robots of the daemon that listens, or will listen, on a socket, until the run ends."""
        process = subprocess.Popen(
            module_command("contid_learn.drive", str(socket), *self._arguments),
            stdin=subprocess.PIPE,
            # Ctrl-C in a terminal is for the daemon, which decides how the run ends.
            start_new_session=True,
        )
        assert process.stdin is not None
        try:
            yield
        finally:
            process.stdin.close()  # it watches this end
            try:
                if process.wait(EXIT_TIMEOUT_S) != 0:
                    self.failed = "the motion of --policy"
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                self.failed = "the motion of --policy"
