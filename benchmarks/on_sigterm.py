"""A benchmark that gets SIGTERM closes what it opened: its daemons, bridges and folders end with it."""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import Final

#: As a shell reports a program that SIGTERM ended.
EXIT_CODE: Final = 128 + signal.SIGTERM


def leave_on_sigterm() -> None:
    """From now on SIGTERM raises `SystemExit` in the main thread, once; context managers close."""
    signal.signal(signal.SIGTERM, _leave)


def _leave(number: int, frame: FrameType | None) -> None:
    signal.signal(number, signal.SIG_IGN)  # a second one must not end the closing
    sys.exit(EXIT_CODE)
