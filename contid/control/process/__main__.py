"""``python -m contid.control.process FD PID``: the control process; binds to its parent first."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from typing import Final

#: Options of prctl(2) by linux/prctl.h: the signal at the death of the parent, and the slack of timers [ns].
_PR_SET_PDEATHSIG: Final = 1
_PR_SET_TIMERSLACK: Final = 29


def bind_to_parent(parent: int) -> bool:
    """Get SIGTERM when the daemon dies, and precise timers; False when the daemon is dead already.

    A daemon that dies before the signal is requested sends none, and this process has another parent.

    Args:
        parent: process id of the daemon.
    """
    for number in (signal.SIGINT, signal.SIGHUP):  # the daemon handles Ctrl-C and the end of a session
        signal.signal(number, signal.SIG_IGN)
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    return os.getppid() == parent


def main(descriptor: int, parent: int) -> int:
    """Run the control process; returns its exit code.

    Args:
        descriptor: file descriptor of the pipe to the daemon.
        parent: process id of the daemon.
    """
    if not bind_to_parent(parent):
        return 0
    from contid.control.process.control_process import main as run
    from contid.control.process.nonblocking_stderr import make_stderr_nonblocking

    make_stderr_nonblocking()
    return run(descriptor)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
