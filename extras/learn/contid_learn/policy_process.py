"""A policy in a process beside a run: the tick never waits for it; one that hangs loses its lease."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from contid.control.daemon.spawn import module_command
from contid_learn.drive import load_drive
from contid_library.process_beside import process_beside


class PolicyProcess:
    """The process of one run.

    Args:
        robot_file: of the run.
        file: of the policy; read here too, so that a wrong one is refused before anything moves.
        goal: text of ``--goal``.
        duration_s: after which the policy ends the run; None: never.
    """

    def __init__(self, robot_file: str, file: str, goal: str, duration_s: float | None) -> None:
        load_drive(robot_file, file, goal)
        self._arguments = [robot_file, file, goal, *([] if duration_s is None else [str(duration_s)])]
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def failed(self) -> str:
        """What is incomplete because the process failed or was killed, "" while nothing is."""
        return "the motion of --policy" if self._process is not None and self._process.returncode else ""

    @contextmanager
    def beside(self, socket: Path) -> Iterator[None]:
        """Drive the robots of the daemon that listens, or will listen, on a socket, until the run ends."""
        command = module_command("contid_learn.drive", str(socket), *self._arguments)
        with process_beside(command) as self._process:
            yield
