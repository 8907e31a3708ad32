"""Runs a program whose CLOCK_MONOTONIC is ahead: arguments SECONDS PROGRAM... It needs root (Linux 5.6)."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from pathlib import Path

CLONE_NEWTIME = 0x80
PR_SET_PDEATHSIG = 1


def prefix(seconds: int) -> list[str]:
    """What to put before a command; nothing for 0."""
    return [sys.executable, "-m", "tests.support.time_namespace", str(seconds)] if seconds else []


def main() -> int:
    seconds, *command = sys.argv[1:]
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(CLONE_NEWTIME):
        raise OSError(ctypes.get_errno(), "unshare")
    Path("/proc/self/timens_offsets").write_text(f"monotonic {seconds} 0\n")
    pid = os.fork()  # only children are in the new namespace
    if not pid:
        libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        os.execvp(command[0], command)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, _: os.kill(pid, number))
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


if __name__ == "__main__":
    sys.exit(main())
