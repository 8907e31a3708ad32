"""Signals that would end a process: given to a handler, or held back while devices are switched off."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

#: Ctrl-C, and the ends of a session and a terminal.
ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def handled_by(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Give `ENDING` signals to a handler within the block; for the main thread."""
    before = {number: signal.signal(number, handler) for number in ENDING}
    try:
        yield
    finally:
        for number, former in before.items():
            signal.signal(number, former)


@contextmanager
def defer_signals() -> Iterator[None]:
    """Hold back signals that would end the process; their handlers run after the block."""
    if threading.current_thread() is not threading.main_thread():
        yield  # handlers run in the main thread only
        return
    received: list[int] = []
    try:
        with handled_by(lambda number, _frame: received.append(number)):
            yield
    finally:
        for late in dict.fromkeys(received):
            signal.raise_signal(late)
