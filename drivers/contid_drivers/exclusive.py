"""One owner per serial port: flock binds those who ask for it, TIOCEXCL everybody except root.

A vendor's wizard or a terminal program asks for no lock. It would read answers that are for contid, and could
write to devices that contid moves; with TIOCEXCL it cannot open the port at all.
"""

from __future__ import annotations

import fcntl
import os
import termios
from contextlib import suppress


def keep_others_out(descriptor: int, path: str) -> None:
    """Nobody else opens this port until `let_others_in`, or until it is closed for the last time."""
    # The end of a pseudo terminal that an emulator holds outlives a killed owner, and the ban with it.
    if not os.path.realpath(path).startswith("/dev/pts/"):
        with suppress(OSError):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)


def let_others_in(descriptor: int) -> None:
    """Undo it; on a dead port nothing is left to undo."""
    with suppress(OSError, ValueError):
        fcntl.ioctl(descriptor, termios.TIOCNXCL)
