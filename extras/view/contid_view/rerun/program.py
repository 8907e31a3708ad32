"""Rerun's own program, on loopback and without usage statistics.

By default its servers listen on every interface and its viewer reports statistics. ``--bind 127.0.0.1`` and
``CI=1``, which Rerun reads as "do not report", prevent both.
"""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import subprocess
import time
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Final

from contid_view.csp_proxy import LOOPBACK
from contid_view.view_target import ViewError

#: How long the program, of 300 MB, may take to start.
START_TIMEOUT_S: Final = 20.0
_PR_SET_PDEATHSIG: Final = 1
_LIBC: Final = ctypes.CDLL(None)


def rerun_program() -> str:
    """Path of Rerun's program itself; the command ``rerun`` is a script that does not forward signals.

    Raises:
        ViewError: it is not installed.
    """
    found = find_spec("rerun_cli")
    program = Path(found.origin).parent / "rerun" if found is not None and found.origin else Path()
    if not program.is_file():
        raise ViewError("the viewer is not installed: pip install rerun-sdk")
    return str(program)


def free_port(preferred: int = 0) -> int:
    """``preferred`` on loopback if it is free, else any."""
    for port in (preferred, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((LOOPBACK, port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise ViewError("no free port on the loopback address")


def start_rerun(
    *arguments: str, outlives: bool = False, stderr: IO[bytes] | None = None
) -> subprocess.Popen[bytes]:
    """Start the program on loopback, without statistics.

    Args:
        arguments: arguments of the program.
        outlives: the program outlives this process.
        stderr: takes its error output, which is dropped otherwise.
    """
    return subprocess.Popen(
        [rerun_program(), "--bind", LOOPBACK, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL if stderr is None else stderr,
        start_new_session=True,
        preexec_fn=None if outlives else _end_with_parent,  # no other thread runs yet
        env={**os.environ, "CI": "1"},
    )


def _end_with_parent() -> None:
    """In the new process: request SIGKILL for the end of its parent."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def await_port(process: subprocess.Popen[bytes], port: int) -> None:
    """Wait until a new server listens.

    Raises:
        ViewError: it ended, or did not listen in time.
    """
    deadline_s = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline_s:
        if process.poll() is not None:
            raise ViewError(f"the viewer ended at its start with status {process.returncode}")
        with socket.socket() as probe:
            if probe.connect_ex((LOOPBACK, port)) == 0:
                return
        time.sleep(0.05)
    raise ViewError(f"the viewer did not listen on port {port} within {START_TIMEOUT_S:g} s")
