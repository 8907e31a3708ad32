"""Exclusive use of a serial port: flock binds cooperating programs, TIOCEXCL every process but root's.

A vendor's wizard or a terminal program takes no lock; it would read contid's answers and could write to
moving devices. With TIOCEXCL it cannot open the port at all.
"""

from __future__ import annotations

import fcntl
import os
import termios
from contextlib import suppress


def lock_port(descriptor: int, path: str) -> None:
    """Refuse further opens of this port until `unlock_port`, or until its last descriptor is closed."""
    # An emulator holds the other end of its pseudo terminal, so the flag would outlive a killed owner.
    if not os.path.realpath(path).startswith("/dev/pts/"):
        with suppress(OSError):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)


def unlock_port(descriptor: int) -> None:
    """Allow further opens again; does nothing on a dead port."""
    with suppress(OSError, ValueError):
        fcntl.ioctl(descriptor, termios.TIOCNXCL)
