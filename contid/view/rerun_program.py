"""Rerun's own program, started on loopback and silent.

Its servers listen on every interface unless told otherwise, and its viewer reports usage statistics: neither
happens here (``--bind 127.0.0.1``; ``CI=1`` is what Rerun itself takes as "do not report").
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

from contid.view.csp_proxy import LOOPBACK
from contid.view.view_target import ViewError

#: How long it may take to begin: the program is 300 MB.
PATIENCE_S: Final = 20.0
_PR_SET_PDEATHSIG: Final = 1
_LIBC: Final = ctypes.CDLL(None)


def rerun_program() -> str:
    """Rerun's own program: the command ``rerun`` is a script around it, which would be in the way of signals.

    Raises:
        ViewError: it is not installed.
    """
    found = find_spec("rerun_cli")
    program = Path(found.origin).parent / "rerun" if found is not None and found.origin else Path()
    if not program.is_file():
        raise ViewError("the viewer is not installed: pip install rerun-sdk")
    return str(program)


def free_port(wanted: int = 0) -> int:
    """``wanted`` on loopback if it is free, else any."""
    for port in (wanted, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((LOOPBACK, port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise ViewError("no free port on the loopback address")


def start_rerun(
    *arguments: str, stays: bool = False, message: IO[bytes] | None = None
) -> subprocess.Popen[bytes]:
    """Start the program on loopback, without statistics.

    Args:
        arguments: of the program.
        stays: it outlives this process.
        message: takes what it says; else nobody hears it.
    """
    return subprocess.Popen(
        [rerun_program(), "--bind", LOOPBACK, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL if message is None else message,
        start_new_session=True,
        preexec_fn=None if stays else _end_with_parent,  # no thread of ours runs yet
        env={**os.environ, "CI": "1"},
    )


def _end_with_parent() -> None:
    """In the new process: be killed when the one that started it ends, however it does."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def await_port(process: subprocess.Popen[bytes], port: int) -> None:
    """Wait until a server that was just started listens.

    Raises:
        ViewError: it ended, or never did.
    """
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        if process.poll() is not None:
            raise ViewError(f"the viewer ended at its start with status {process.returncode}")
        with socket.socket() as probe:
            if probe.connect_ex((LOOPBACK, port)) == 0:
                return
        time.sleep(0.05)
    raise ViewError(f"the viewer did not listen on port {port} within {PATIENCE_S:g} s")
